"""Methods compared over trials: means, bootstrap confidence intervals, paired tests."""

from __future__ import annotations

import warnings
from dataclasses import dataclass

import numpy as np
from scipy import stats

from fbgraph.core.geometry import FloatArray

CONFIDENCE = 0.95
RESAMPLES = 9999
_SEED = 0  # of the bootstrap: equal trials give equal intervals


@dataclass(frozen=True)
class Overall:
    """One method over all trials; means over trials, metres unless said otherwise.

    Attributes:
        rmse_m, mean_m, max_m, final_m: means of the trials' own.
        rmse_sd_m, rmse_median_m: of the trials' RMSE.
        rmse_low_m, rmse_high_m: bootstrap confidence interval of the mean RMSE.
        held_out_rmse_m: mean RMSE with everything fitted on the other trials; nan where nothing is fitted.
        improvement_percent: mean over trials of 100 (PDR - method) / PDR, as the paper's 15.76 % must be
            (its mean RMSEs alone would give 14.5 %); nan for PDR itself.
        improvement_of_means_percent: the same of the mean RMSEs.
        turns_matched, turns_missed, turns_false: events.
        turn_precision, turn_recall: shares; nan without events.
        turn_consistency_percent: matched / (matched + missed + false).
        turn_late_s, turn_apart_s: mean and mean absolute time of detected after labelled turns.
        heading_rms_deg: RMS heading error over all steps; nan where the method tells none.
    """

    rmse_m: float
    rmse_sd_m: float
    rmse_median_m: float
    rmse_low_m: float
    rmse_high_m: float
    mean_m: float
    max_m: float
    final_m: float
    held_out_rmse_m: float
    improvement_percent: float
    improvement_of_means_percent: float
    turns_matched: int
    turns_missed: int
    turns_false: int
    turn_precision: float
    turn_recall: float
    turn_consistency_percent: float
    turn_late_s: float
    turn_apart_s: float
    heading_rms_deg: float


@dataclass(frozen=True)
class Paired:
    """Two methods on the same trials: RMSE of ``better`` less that of ``worse``, metres, negative if it is better.

    Attributes:
        ratio: of the mean RMSEs.
        difference_m: mean; ``low_m``, ``high_m`` its bootstrap confidence interval.
        wilcoxon_p, t_p: two-sided, of the signed-rank and the paired t test; nan with too few trials.
        wins: trials in which ``better`` was.
    """

    better: str
    worse: str
    ratio: float
    difference_m: float
    low_m: float
    high_m: float
    wilcoxon_p: float
    t_p: float
    wins: int
    trials: int


@dataclass(frozen=True)
class Current:
    """What the device drew, mA, over the samples of all trials that logged it."""

    mean_ma: float
    sd_ma: float
    min_ma: float
    max_ma: float
    trials: int


@dataclass(frozen=True)
class Comparison:
    """All of it; ``overall`` by method name."""

    overall: dict[str, Overall]
    paired: tuple[Paired, ...]
    current: Current | None


def interval_of_mean(values: FloatArray) -> tuple[float, float]:
    """Bootstrap confidence interval (BCa; percentile where that is undefined) of a mean; nan for fewer than three."""
    if len(values) < 3:
        return float("nan"), float("nan")
    for method in ("BCa", "percentile"):
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # equal values: BCa says nan, and so it is tried otherwise
            low, high = stats.bootstrap(
                (values,),
                np.mean,
                n_resamples=RESAMPLES,
                confidence_level=CONFIDENCE,
                method=method,
                rng=np.random.default_rng(_SEED),
            ).confidence_interval
        if np.isfinite((low, high)).all():
            break
    return float(low), float(high)


def paired(better: str, worse: str, better_m: FloatArray, worse_m: FloatArray) -> Paired:
    """Compare two methods' RMSE (T,) on the same trials."""
    difference = better_m - worse_m
    low, high = interval_of_mean(difference)
    testable = len(difference) >= 2 and bool((difference != 0).any()) and float(np.ptp(difference)) > 0
    return Paired(
        better=better,
        worse=worse,
        ratio=float(better_m.mean() / worse_m.mean()),
        difference_m=float(difference.mean()),
        low_m=low,
        high_m=high,
        wilcoxon_p=float(stats.wilcoxon(better_m, worse_m).pvalue) if testable else float("nan"),
        t_p=float(stats.ttest_rel(better_m, worse_m).pvalue) if testable else float("nan"),
        wins=int((difference < 0).sum()),
        trials=len(difference),
    )


def current_of(trials_ma: list[FloatArray]) -> Current | None:
    """Statistics of the logged currents; None if no trial has any."""
    logged = [values for values in trials_ma if len(values)]
    if not logged:
        return None
    every = np.concatenate(logged)
    return Current(float(every.mean()), float(every.std()), float(every.min()), float(every.max()), len(logged))
