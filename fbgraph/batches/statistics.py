"""Figures of a batch: errors with intervals, coverage, verdicts, failures; and of two, what changed between them."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from fbgraph.batches.index_row import DONE, ESTIMATORS, FAILED
from fbgraph.core.geometry import FloatArray

if TYPE_CHECKING:
    import pandas as pd

CONFIDENCE = 0.95
SHARES = (0.5, 0.95)
"""Quantiles that are told."""
VERDICTS = ("sound", "doubtful", "withheld")
_MANY = 1000  # means of more are normal enough


@dataclass(frozen=True)
class Estimate:
    """A figure and the interval in which it lies with 95 %; nan where so few walks do not tell one."""

    value: float
    low: float
    high: float

    def text(self, digits: int = 2) -> str:
        """``1.94 (1.71–2.20)``."""
        if not np.isfinite(self.value):
            return "–"
        if not np.isfinite((self.low, self.high)).all():
            return f"{self.value:.{digits}f}"
        return f"{self.value:.{digits}f} ({self.low:.{digits}f}–{self.high:.{digits}f})"


@dataclass(frozen=True)
class Errors:
    """The RMSE of one estimator over the walks that have truth, metres.

    Attributes:
        estimator: whose.
        walks: how many.
        mean: by bootstrap over walks; normal for many.
        quantiles: of ``SHARES``, with intervals by order statistics, which assume nothing of the distribution
            (David, Nagaraja, Order Statistics, 2003, section 7.1).
        worst_m: the largest.
    """

    estimator: str
    walks: int
    mean: Estimate
    quantiles: tuple[Estimate, ...]
    worst_m: float


def known(column: pd.Series) -> FloatArray:
    """The values of a column that are known."""
    values = column.to_numpy(dtype=float, na_value=np.nan)
    return np.asarray(values[np.isfinite(values)])


def mean_of(values: FloatArray) -> Estimate:
    """A mean over walks."""
    from scipy.special import ndtri

    from fbgraph.study.comparison import interval_of_mean  # scipy.stats takes a second to import

    if len(values) == 0:
        return Estimate(np.nan, np.nan, np.nan)
    mean = float(values.mean())
    if len(values) <= _MANY:
        return Estimate(mean, *interval_of_mean(values))
    half = float(ndtri(0.5 + CONFIDENCE / 2.0)) * float(values.std(ddof=1)) / float(np.sqrt(len(values)))
    return Estimate(mean, mean - half, mean + half)


def quantile_of(values: FloatArray, share: float) -> Estimate:
    """A quantile over walks, and the order statistics between which the true one lies."""
    from scipy.special import bdtr

    ordered, count = np.sort(values), len(values)
    if count == 0:
        return Estimate(np.nan, np.nan, np.nan)
    tail = (1.0 - CONFIDENCE) / 2.0
    below = bdtr(np.arange(count + 1.0), count, share)  # how likely at most so many walks are below it
    low, high = int(np.searchsorted(below, tail)) - 1, int(np.searchsorted(below, 1.0 - tail))
    return Estimate(
        float(np.quantile(ordered, share)),
        float(ordered[low]) if low >= 0 else np.nan,
        float(ordered[high]) if high < count else np.nan,
    )


def errors_of(frame: pd.DataFrame) -> list[Errors]:
    """Of each estimator; none where no walk has truth."""
    found = []
    for name in ESTIMATORS:
        rmse_m = known(frame[f"{name}_rmse_m"])
        if len(rmse_m):
            quantiles = tuple(quantile_of(rmse_m, share) for share in SHARES)
            found.append(Errors(name, len(rmse_m), mean_of(rmse_m), quantiles, float(rmse_m.max())))
    return found


def coverage_of(frame: pd.DataFrame) -> tuple[int, int, Estimate] | None:
    """Places within the smoother's 95 % ellipses, of how many, and the mean share of a walk's; None without truth."""
    inside, ellipses = (known(frame[name]) for name in ("inside_95", "ellipses"))
    if len(ellipses) == 0:
        return None
    return int(inside.sum()), int(ellipses.sum()), mean_of(100.0 * inside / ellipses)


def verdict_counts(frame: pd.DataFrame) -> dict[str, int]:
    """How many runs are sound, doubtful, withheld."""
    runs = frame[frame["status"] == DONE]
    return {verdict: int((runs["verdict"] == verdict).sum()) for verdict in VERDICTS}


@dataclass(frozen=True)
class Failures:
    """Logs that failed for one cause.

    Attributes:
        cause: as of an ``Outcome``.
        logs: how many.
        name, reason: of the first.
    """

    cause: str
    logs: int
    name: str
    reason: str


def failures_of(frame: pd.DataFrame) -> list[Failures]:
    """By cause, the most frequent first."""
    failed = frame[frame["status"] == FAILED]
    groups = [(str(cause), rows) for cause, rows in failed.groupby("cause", sort=True)]
    groups.sort(key=lambda one: -len(one[1]))
    return [
        Failures(cause, len(rows), str(rows["name"].iloc[0]), str(rows["reason"].iloc[0])) for cause, rows in groups
    ]


def best_rmse_m(frame: pd.DataFrame) -> pd.Series:
    """The error of each walk as it is believed: the smoother's, else the EKF's; empty without truth."""
    return frame["smoothed_rmse_m"].fillna(frame["ekf_rmse_m"])


def worst_of(frame: pd.DataFrame, count: int = 10) -> pd.DataFrame:
    """The worst runs: by error where any walk has truth, else by verdict and by how sure their ends are."""
    runs = frame[frame["run"].fillna("") != ""]
    rmse_m = best_rmse_m(runs)
    if rmse_m.notna().any():
        return runs.loc[rmse_m.dropna().sort_values(ascending=False, kind="stable").index[:count]]
    rank = runs["verdict"].map({"withheld": 0, "doubtful": 1}).fillna(2)
    ordered = runs.assign(_rank=rank).sort_values(["_rank", "end_2sigma_m"], ascending=[True, False], kind="stable")
    return ordered.drop(columns="_rank").head(count)
