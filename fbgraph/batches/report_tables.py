"""The figures of batches as rows of text, the first the head: for a terminal and for the page alike."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from fbgraph.batches.changes import Changes
from fbgraph.batches.statistics import (
    best_rmse_m,
    coverage_of,
    errors_of,
    failures_of,
    verdict_counts,
    worst_of,
)
from fbgraph.core.colors import LABELS

if TYPE_CHECKING:
    import pandas as pd

Rows = list[list[str]]


def headline(frame: pd.DataFrame) -> str:
    """A batch in a sentence."""
    runs = frame["run"].notna() & (frame["run"] != "")
    done = int((frame["status"] == "done").sum())
    walked_h, walked_km = (float(frame.loc[runs, name].sum()) for name in ("walk_s", "distance_m"))
    told = ", ".join(f"{count:,} {verdict}" for verdict, count in verdict_counts(frame).items() if count)
    return (
        f"{len(frame):,} logs: {done:,} done ({told or 'none'}), {len(frame) - done:,} failed; "
        f"{walked_km / 1000.0:,.1f} km in {walked_h / 3600.0:,.1f} h of walking"
    )


def error_rows(frame: pd.DataFrame) -> Rows:
    """The distribution of the walks' RMSE, by estimator, with 95 % intervals; the head alone without truth."""
    rows = [["estimator", "scored", "mean m", "median m", "95 % below m", "worst m"]]
    for one in errors_of(frame):
        quantiles = [quantile.text() for quantile in one.quantiles]
        rows.append([LABELS[one.estimator], f"{one.walks:,}", one.mean.text(), *quantiles, f"{one.worst_m:.2f}"])
    return rows


def coverage_text(frame: pd.DataFrame) -> str:
    """How many known places lie in the ellipses; ``""`` without truth."""
    covered = coverage_of(frame)
    if covered is None:
        return ""
    inside, of, share = covered
    return (
        f"{inside:,} of {of:,} known places ({100.0 * inside / of:.1f} %) lie in the smoother's 95 % ellipses; of one "
        f"walk's, on average over walks, {share.text(1)} %"
    )


def verdict_rows(frame: pd.DataFrame) -> Rows:
    """How many runs have each verdict, and how far those are off."""
    rows = [["verdict", "runs", "scored", "median RMSE m", "95 % below m"]]
    for verdict, count in verdict_counts(frame).items():
        rmse_m = best_rmse_m(frame[(frame["verdict"] == verdict) & (frame["status"] == "done")]).dropna()
        told = [f"{float(rmse_m.quantile(share)):.2f}" if len(rmse_m) else "–" for share in (0.5, 0.95)]
        rows.append([verdict, f"{count:,}", f"{len(rmse_m):,}", *told])
    return rows


def failure_rows(frame: pd.DataFrame) -> Rows:
    """Failures by cause, each with its first."""
    found = [[one.cause, f"{one.logs:,}", f"{one.name}: {one.reason}"] for one in failures_of(frame)]
    return [["cause", "logs", "the first"], *found]


def worst_rows(frame: pd.DataFrame, count: int = 10) -> Rows:
    """The worst runs."""
    rows = [["run", "RMSE m", "max m", "walked m", "± m at the end (2σ)", "verdict", "why"]]
    for _, one in worst_of(frame, count).iterrows():
        best = "smoothed" if _known(one["smoothed_rmse_m"]) else "ekf"
        numbers = [one[name] for name in (f"{best}_rmse_m", f"{best}_max_m", "distance_m", "end_2sigma_m")]
        rows.append([str(one["name"]), *map(_number, numbers), str(one["verdict"]), str(one["why"] or "")])
    return rows


def failed_rows(frame: pd.DataFrame, count: int = 200) -> Rows:
    """Every log that failed, up to so many."""
    failed = frame[frame["status"] == "failed"].head(count)
    rows = [[str(one[name]) for name in ("name", "cause", "reason")] for _, one in failed.iterrows()]
    return [["log", "cause", "reason"], *rows]


def paired_rows(found: Changes) -> Rows:
    """Paired differences by estimator."""
    rows = [["estimator", "scored in both", "before m", "after m", "difference m", "better", "worse", "Wilcoxon p"]]
    for one in found.paired:
        p = "–" if np.isnan(one.wilcoxon_p) else "< 0.0001" if one.wilcoxon_p < 1e-4 else f"{one.wilcoxon_p:.4f}"
        means = [f"{one.before_m:.3f}", f"{one.after_m:.3f}", one.difference.text(3)]
        rows.append([LABELS[one.estimator], f"{one.walks:,}", *means, f"{one.better:,}", f"{one.worse:,}", p])
    return rows


def changed_text(found: Changes) -> str:
    """How many walks changed, and which logs only one batch has."""
    told = [f"{len(found.walks):,} of {found.both:,} walks changed"]
    for names, which in ((found.only_before, "first"), (found.only_after, "second")):
        if names:
            told.append(f"{len(names):,} only in the {which} ({', '.join(names[:3])}{', …' if len(names) > 3 else ''})")
    return "; ".join(told)


def changed_rows(found: Changes, count: int = 10) -> Rows:
    """The walks that changed most."""
    rows = [["run", "before m", "after m", "difference m", "end moved m", "what"]]
    for _, one in found.walks.head(count).iterrows():
        difference = f"{one['difference_m']:+.3f}" if _known(one["difference_m"]) else "–"
        numbers = [_number(one["before_m"]), _number(one["after_m"]), difference, _number(one["end_moved_m"])]
        rows.append([str(one["name"]), *numbers, str(one["what"])])
    return rows


def _known(value: object) -> bool:
    return isinstance(value, int | float) and bool(np.isfinite(value))


def _number(value: object) -> str:
    return f"{value:.2f}" if _known(value) else "–"
