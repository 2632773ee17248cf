"""Parameters of step detection and step length, fitted to trials (paper, section Parameter Selection).

α, β and γ of L = α + β f + γ s by least squares (``front_end.length_fit``): a row for each route segment between
checkpoints with the mean step frequency and slope there, and its length over the number of steps as the reference step
length. L0 of the baseline is the same fit with the constant alone. λ by trying: the paper chose it "empirically to
avoid false step detections while preserving true walking peaks".
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from fbgraph.core.config import Config, StepLengthConfig
from fbgraph.core.errors import DataError
from fbgraph.core.geometry import FloatArray, wrap_angle
from fbgraph.front_end.length_fit import least_squares, step_shares
from fbgraph.front_end.step_track import StepTrack
from fbgraph.study.trial import Trial, Turns

LAMBDAS = tuple(round(0.1 * k, 1) for k in range(11))
"""What is tried for λ."""
_MIN_SLOPED = 0.1  # share of segments with a slope, below which slope is but the barometer's noise
_MIN_SPREAD_HZ = 0.01  # of step frequency
_ALIKE = 1.01  # a residual at most so many times the least is as good


@dataclass(frozen=True)
class StepModel:
    """Fitted parameters.

    Attributes:
        lambda_sigma: λ of the step threshold.
        constant_m: L0 of the baseline.
        alpha_m, beta_m_s, gamma_m: of the adaptive model.
        kept: those of alpha, beta, gamma that the trials cannot tell and that stay as configured.
        segments: rows of the regression.
        residual_m: its RMS.
    """

    lambda_sigma: float
    constant_m: float
    alpha_m: float
    beta_m_s: float
    gamma_m: float
    kept: tuple[str, ...]
    segments: int
    residual_m: float

    def apply(self, config: Config) -> Config:
        """The configuration with these parameters, and without the terms that the paper's model has not."""
        names = ("constant_m", "alpha_m", "beta_m_s", "gamma_m")
        length = {name: getattr(self, name) for name in names} | {"beta2_m_s2": 0.0, "kappa_surge": 0.0}
        return config.model_copy(
            update={
                "steps": config.steps.model_copy(update={"lambda_sigma": self.lambda_sigma}),
                "step_length": config.step_length.model_copy(update=length),
            }
        )


@dataclass(frozen=True)
class Evidence:
    """What one trial says about the parameters at one λ.

    Attributes:
        segments: (S, 3) mean step frequency, mean slope and reference step length.
        miscounted: by how many steps detection is off the labels; None without labels.
    """

    segments: FloatArray
    miscounted: int | None


def evidence(track: StepTrack | None, trial: Trial, turns: Turns) -> Evidence:
    """Compare detected steps (None: not any) with a trial's distances and labels.

    Segments go from checkpoint to checkpoint; without a column of those, from turn to turn.
    """
    count = 0 if track is None else len(track) - 1
    miscounted = None if trial.step_s is None else abs(count - len(trial.step_s))
    if track is None:
        return Evidence(np.empty((0, 3)), miscounted)
    inner = trial.checkpoint_s[1:-1] if len(trial.checkpoint_s) > 2 else turns.t_s
    truth = trial.truth
    edges = np.concatenate(([min(truth.t_s[0], track.start_s[1])], inner, [max(truth.t_s[-1], track.t_s[-1])]))
    walked_m = np.interp(edges, truth.t_s, truth.distance_m)
    rows = []
    for (lo, hi), length_m in zip(pairwise(edges), np.diff(walked_m), strict=True):
        share = step_shares(track, lo, hi)
        steps = float(share.sum())
        if steps >= 1.0:
            frequency, slope = (float((share * v[1:]).sum()) / steps for v in (track.frequency_hz, track.slope))
            rows.append((frequency, slope, length_m / steps))
    return Evidence(np.array(rows).reshape(-1, 3), miscounted)


def fit(by_lambda: dict[float, Sequence[Evidence]], config: Config) -> StepModel:
    """Fit λ, then the step lengths.

    Args:
        by_lambda: the evidence of the same trials at each λ.
        config: its λ wins among equals; what the trials cannot tell stays as it has it.

    Raises:
        DataError: no trial with a walked segment.
    """
    models = {
        value: _regress(np.concatenate([e.segments for e in all_]), config.step_length, value)
        for value, all_ in by_lambda.items()
        if any(len(e.segments) for e in all_)
    }
    if not models:
        raise DataError("no trial has steps between its checkpoints: nothing to fit the step length to")
    counts = {value: [e.miscounted for e in by_lambda[value]] for value in models}
    if all(count is not None for all_ in counts.values() for count in all_):
        cost = {value: float(sum(count or 0 for count in all_)) for value, all_ in counts.items()}
        best = [value for value in models if cost[value] == min(cost.values())]
    else:
        least = min(model.residual_m for model in models.values())
        best = [value for value, model in models.items() if model.residual_m <= _ALIKE * least]
    return models[min(best, key=lambda value: abs(value - config.steps.lambda_sigma))]


def _regress(rows: FloatArray, config: StepLengthConfig, lambda_sigma: float) -> StepModel:
    """α, β, γ from (S, 3) segments; those that they cannot tell are kept and their part taken off the lengths."""
    frequency, slope, length = rows.T
    features = {"alpha_m": np.ones(len(rows)), "beta_m_s": frequency, "gamma_m": slope}
    kept = []
    if len(rows) < 4 or np.std(frequency) < _MIN_SPREAD_HZ:
        kept.append("beta_m_s")
    if len(rows) < 4 or np.mean(slope != 0.0) < _MIN_SLOPED:
        kept.append("gamma_m")
    values = {name: float(getattr(config, name)) for name in features}
    rest = length - sum((values[name] * features[name] for name in kept), np.zeros(len(rows)))
    fitted = [name for name in features if name not in kept]
    solution, _ = least_squares(np.column_stack([features[name] for name in fitted]), rest)
    values |= dict(zip(fitted, solution.tolist(), strict=True))
    residual = length - sum((values[name] * features[name] for name in features), np.zeros(len(rows)))
    return StepModel(
        lambda_sigma=lambda_sigma,
        constant_m=float(length.mean()),
        kept=tuple(kept),
        segments=len(rows),
        residual_m=float(np.sqrt((residual**2).mean())),
        **values,
    )


def map_offset_rad(tracks: Sequence[StepTrack], trials: Sequence[Trial]) -> tuple[float, float]:
    """How far the compass's directions are from the ground truth's, over all trials: mean, and its standard error.

    A large one means that the map's x axis is not East, or that the device points elsewhere than ``device.mount`` says.
    nan where no trial has a compass.
    """
    offsets = []
    for track, trial in zip(tracks, trials, strict=True):
        known = np.isfinite(track.yaw_mag_rad)
        if known.any():
            really = np.interp(track.yaw_s[known], trial.truth.t_s, trial.truth.heading_rad)
            offsets.append(np.angle(np.exp(1j * (track.yaw_mag_rad[known] - really)).mean()))
    if not offsets:
        return float("nan"), float("nan")
    mean = float(np.angle(np.exp(1j * np.array(offsets)).mean()))
    spread = wrap_angle(np.array(offsets) - mean)
    return mean, float(np.sqrt((spread**2).mean() / len(offsets)))
