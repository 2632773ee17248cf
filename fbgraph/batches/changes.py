"""Two batches of the same logs side by side: paired differences, and which walks changed."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from fbgraph.batches.index_row import DONE, ESTIMATORS
from fbgraph.batches.statistics import Estimate, best_rmse_m, mean_of
from fbgraph.core.errors import DataError
from fbgraph.core.geometry import FloatArray

if TYPE_CHECKING:
    import pandas as pd

CHANGED_M = 0.001
"""A walk whose error or end moved by more is another."""


@dataclass(frozen=True)
class PairedErrors:
    """The RMSE of one estimator in the second batch less that in the first, on the walks that both scored.

    Attributes:
        estimator: whose.
        walks: how many.
        before_m, after_m: means.
        difference: mean, metres; negative where the second is better.
        better, worse: walks that moved by more than ``CHANGED_M``.
        wilcoxon_p: two-sided, of the signed-rank test (Wilcoxon, Biometrics Bulletin 1, 1945); nan where none moved.
    """

    estimator: str
    walks: int
    before_m: float
    after_m: float
    difference: Estimate
    better: int
    worse: int
    wilcoxon_p: float


@dataclass(frozen=True)
class Changes:
    """What is otherwise in the second batch.

    Attributes:
        paired: by estimator; none where no walk has truth in both.
        both: logs in both batches, by their names.
        only_before, only_after: names of logs that one of them lacks.
        walks: a row a walk that changed: ``name``, ``what``, errors before and after, ``difference_m`` of them, how far
            the end moved; what failed or is done now first, then by how much.
    """

    paired: tuple[PairedErrors, ...]
    both: int
    only_before: tuple[str, ...]
    only_after: tuple[str, ...]
    walks: pd.DataFrame


def changes(before: pd.DataFrame, after: pd.DataFrame) -> Changes:
    """Compare two indices.

    Raises:
        DataError: they have no log in common.
    """
    a, b = before.set_index("name"), after.set_index("name")
    names = a.index.intersection(b.index)
    if len(names) == 0:
        raise DataError("the two batches have no log in common, by the names of their runs")
    only_before, only_after = (tuple(map(str, one.index.difference(names))) for one in (a, b))
    a, b = a.loc[names], b.loc[names]
    pairs = (_paired(name, _metres(a, f"{name}_rmse_m"), _metres(b, f"{name}_rmse_m")) for name in ESTIMATORS)
    return Changes(tuple(one for one in pairs if one is not None), len(names), only_before, only_after, _changed(a, b))


def _metres(frame: pd.DataFrame, name: str) -> FloatArray:
    return frame[name].to_numpy(dtype=float, na_value=np.nan)


def _paired(name: str, before_m: FloatArray, after_m: FloatArray) -> PairedErrors | None:
    from scipy import stats  # takes a second

    known = np.isfinite(before_m) & np.isfinite(after_m)
    before_m, after_m = before_m[known], after_m[known]
    if not known.any():
        return None
    moved_m = after_m - before_m
    told = len(moved_m) > 1 and bool((moved_m != 0.0).any())
    return PairedErrors(
        estimator=name,
        walks=int(known.sum()),
        before_m=float(before_m.mean()),
        after_m=float(after_m.mean()),
        difference=mean_of(moved_m),
        better=int((moved_m < -CHANGED_M).sum()),
        worse=int((moved_m > CHANGED_M).sum()),
        wilcoxon_p=float(stats.wilcoxon(moved_m).pvalue) if told else np.nan,
    )


def _changed(a: pd.DataFrame, b: pd.DataFrame) -> pd.DataFrame:
    """Walks whose status, verdict, error or end is not the same."""
    import pandas as pd

    before_m, after_m = (best_rmse_m(one).to_numpy(dtype=float, na_value=np.nan) for one in (a, b))
    ends = [np.column_stack([_metres(one, f"end_{axis}_m") for axis in "xyz"]) for one in (a, b)]
    moved_m = np.linalg.norm(ends[1] - ends[0], axis=1)
    difference_m = after_m - before_m
    what = []
    for (_, was), (_, now) in zip(a.iterrows(), b.iterrows(), strict=True):
        if was["status"] != now["status"]:
            what.append("done now" if now["status"] == DONE else f"failed: {now['reason']}")
        elif was["verdict"] != now["verdict"]:
            what.append(f"{was['verdict']}, now {now['verdict']}")
        else:
            what.append("")
    table = pd.DataFrame(
        {
            "name": a.index,
            "what": what,
            "before_m": before_m,
            "after_m": after_m,
            "difference_m": difference_m,
            "end_moved_m": moved_m,
        }
    )
    status = (a["status"] != b["status"]).to_numpy(dtype=bool)
    size = np.nan_to_num(np.where(np.isfinite(difference_m), np.abs(difference_m), moved_m), nan=0.0)
    by_more = (np.nan_to_num(np.abs(difference_m)) > CHANGED_M) | (np.nan_to_num(moved_m) > CHANGED_M)
    order = np.lexsort((-size, ~status))
    return table.iloc[[int(k) for k in order if by_more[k] or what[k]]].reset_index(drop=True)
