"""What happened on a walk, and when: stretches to show as lanes over time, and sentences for people."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from fbgraph.attitude import LevelledSignals
from fbgraph.field import FieldMemory
from fbgraph.geometry import BoolArray, FloatArray, wrap_angle
from fbgraph.result import WalkResult
from fbgraph.steps import StepTrack

Lane = list[tuple[float, str | None]]
"""Changes of state in order of time: since when (seconds), what; None is nothing to tell."""

STANDING, WALKING, MOVING = "standing still", "walking", "moving, no steps"
TRUSTED, DOUBTED = "trusted", "doubted"

_HALF = 0.5  # of the usual pull; a compass that is left less is doubted
_SHORT_STEPS = 3  # a stretch of fewer is not worth telling, a break of fewer does not end one
_PAUSE_S = 3.0  # walking without a step for longer is told
_BLINK_S = 1.0  # a shorter stretch of neither standing nor walking is neither's end
_SLOW, _FAST = 0.7, 1.4  # of the usual step frequency
_MOST = 5  # stretches of one kind that are told


@dataclass(frozen=True)
class Finding:
    """A stretch of a walk that deserves a look; ``start_s``, ``end_s`` since log start."""

    kind: str
    start_s: float
    end_s: float
    text: str


def wearer_lane(signals: LevelledSignals, track: StepTrack | None, still_window_s: float) -> Lane:
    """What the wearer did: ``STANDING``, ``WALKING``, ``MOVING`` (by hand or foot, but no steps were found).

    Args:
        signals: for how long to tell.
        track: the steps; None if there are none yet.
        still_window_s: how long before it is known standing still begins.
    """
    t_s = signals.t_s
    if len(t_s) == 0:
        return []

    def covered(start_s: FloatArray, end_s: FloatArray) -> BoolArray:
        """Which samples lie in any of these stretches."""
        edges = np.zeros(len(t_s) + 1, dtype=np.int64)
        np.add.at(edges, np.searchsorted(t_s, start_s), 1)
        np.add.at(edges, np.searchsorted(t_s, end_s), -1)
        return np.asarray(np.cumsum(edges)[:-1] > 0)

    rate_hz = 1.0 / np.median(np.diff(t_s)) if len(t_s) > 1 else 1.0
    edges = np.flatnonzero(np.diff(np.concatenate(([False], signals.still, [False])).astype(int)))
    # stillness is known at the end of its window
    still = covered(t_s[edges[::2]] - still_window_s, t_s[edges[1::2] - 1] + 1.0 / rate_hz)
    walking = covered(track.start_s[1:], track.t_s[1:]) if track is not None else np.zeros(len(t_s), dtype=bool)
    state = np.where(walking, 2, np.where(still, 1, 0))
    names = (MOVING, STANDING, WALKING)
    lane: Lane = []
    at = np.flatnonzero(np.diff(state, prepend=-1))
    for i, end in zip(at, [*at[1:], len(t_s)], strict=True):
        blink = lane and state[i] == 0 and end - i < _BLINK_S * rate_hz
        if not blink and (not lane or lane[-1][1] != names[state[i]]):
            lane.append((float(t_s[i]), names[state[i]]))
    return lane


def compass_trust(result: WalkResult) -> FloatArray:
    """(K+1,) share of its usual pull that the smoother left the compass at each step; nan without a compass.

    The field's deviation from its recent usual divides it (``FieldMemory.inflation``), the robust loss multiplies it.
    """
    graph, track = result.config.graph, result.track
    memory = FieldMemory(graph.norm_scale_ut, graph.dip_scale_rad)
    inflation = np.array([memory.inflation(step) if np.isfinite(step.yaw_mag_rad) else np.nan for step in track.steps])
    weight = np.ones(len(track))
    for residuals in result.smoothed.residuals:
        if residuals.name == "compass":
            weight[residuals.k] = residuals.weight
    return np.asarray(weight / inflation)


def stretches(flags: BoolArray, shortest: int = _SHORT_STEPS) -> list[tuple[int, int]]:
    """First and last index of runs of true flags; breaks shorter than ``shortest`` are bridged, short runs dropped."""
    at = np.flatnonzero(flags)
    if len(at) == 0:
        return []
    runs = np.split(at, np.flatnonzero(np.diff(at) > shortest) + 1)
    return [(int(run[0]), int(run[-1])) for run in runs if len(run) >= shortest]


def compass_lane(result: WalkResult) -> Lane:
    """Where the smoother believed the compass, and where it left it less than half its pull."""
    trust = compass_trust(result)
    known = np.flatnonzero(np.isfinite(trust))
    if len(known) == 0:
        return []
    t_s = result.track.t_s
    lane: Lane = [(float(result.track.start_s[known[0]]), TRUSTED)]
    for first, last in stretches(trust < _HALF):
        lane += [(float(result.track.start_s[first]), DOUBTED), (float(t_s[last]), TRUSTED)]
    return [*lane, (float(t_s[known[-1]]), None)]


def find(result: WalkResult) -> list[Finding]:
    """Everything worth telling of a walk, in order of time; of each kind the longest stretches only."""
    kinds = (_compass(result), _steps(result), _gaps(result), _places(result))
    chosen = [f for kind in kinds for f in sorted(kind, key=lambda f: f.start_s - f.end_s)[:_MOST]]
    return sorted([*chosen, *_bias(result)], key=lambda finding: finding.start_s)


def _compass(result: WalkResult) -> list[Finding]:
    track, smoothed = result.track, result.smoothed.trajectory
    off = np.degrees(wrap_angle(track.yaw_mag_rad - smoothed.yaw_rad))
    distance_m = smoothed.distance_m
    found = []
    for first, last in stretches(compass_trust(result) < _HALF):
        span = slice(first, last + 1)
        worst = off[span][np.nanargmax(np.abs(off[span]))]
        norm = track.mag_norm_ut[span]
        found.append(
            Finding(
                "compass",
                float(track.start_s[first]),
                float(track.t_s[last]),
                f"compass doubted for {distance_m[last] - distance_m[max(first - 1, 0)]:.0f} m "
                f"(steps {first} to {last}): "
                f"up to {abs(worst):.0f}° off to the {'left' if worst > 0 else 'right'} of the smoothed heading, "
                f"field {np.nanmin(norm):.0f} to {np.nanmax(norm):.0f} µT",
            )
        )
    return found


def _steps(result: WalkResult) -> list[Finding]:
    """Walking without steps, and steps much slower or faster than usual: found too few, or too many."""
    track = result.track
    usual_hz = float(np.median(track.frequency_hz[1:]))
    found = []
    for name, which in (
        ("slower", track.frequency_hz < _SLOW * usual_hz),
        ("faster", track.frequency_hz > _FAST * usual_hz),
    ):
        which[0] = False  # the standing start
        cause = "some may have been missed" if name == "slower" else "some may be false"
        for first, last in stretches(which):
            rate = np.median(track.frequency_hz[first : last + 1])
            text = f"steps {first} to {last} much {name} than usual ({rate:.1f} against {usual_hz:.1f} Hz): {cause}"
            found.append(Finding("steps", float(track.start_s[first]), float(track.t_s[last]), text))
    lane = wearer_lane(result.signals, track, result.config.attitude.still_window_s)
    ends = [*(t for t, _ in lane[1:]), result.track.t_s[-1]]
    for (start_s, state), end_s in zip(lane, ends, strict=True):
        inside = track.t_s[0] < start_s and end_s <= track.t_s[-1]
        if state == MOVING and inside and end_s - start_s > _PAUSE_S:
            text = (
                f"neither still nor stepping for {end_s - start_s:.0f} s: handling, turning on the spot, missed steps"
            )
            found.append(Finding("steps", start_s, float(end_s), text))
    return found


def _gaps(result: WalkResult) -> list[Finding]:
    track = result.track
    return [
        Finding(
            "gap", float(track.t_s[k - 1]), float(track.t_s[k]), "gap in the log: direction across it is the compass's"
        )
        for k in np.flatnonzero(track.chained == 0)
    ]


def _places(result: WalkResult) -> list[Finding]:
    """Anchors and closures: how far from them the smoothed walk stayed, and which were doubted."""
    found = []
    for kind in result.smoothed.residuals:
        if kind.name not in ("anchor", "closure"):
            continue
        for k, whitened, weight in zip(kind.k, kind.whitened, kind.weight, strict=True):
            if weight < _HALF:
                at_s = float(result.track.t_s[k])
                text = f"{kind.name} at step {k} doubted: the walk stays {abs(whitened):.1f} sigma away from it"
                found.append(Finding(kind.name, at_s, at_s, text))
    return found


def _bias(result: WalkResult) -> list[Finding]:
    """One sentence on the gyroscope's bias, at the end of the walk."""
    smoothed = result.smoothed.trajectory
    bias = np.degrees(smoothed.gyro_bias_rad_s)
    sigma = smoothed.sigma_bias_rad_s
    give = f" ± {2.0 * np.degrees(sigma[-1]):.2f}" if sigma is not None else ""
    text = (
        f"gyroscope bias {bias[-1]:+.2f}{give} °/s (2 sigma) at the end; "
        f"it moved between {bias.min():+.2f} and {bias.max():+.2f} °/s"
    )
    return [Finding("gyro_bias", float(smoothed.t_s[-1]), float(smoothed.t_s[-1]), text)]
