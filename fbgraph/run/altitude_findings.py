"""Air pressure that was not altitude, and altitude without steps, in sentences."""

from __future__ import annotations

import itertools

import numpy as np

from fbgraph.core.geometry import BoolArray
from fbgraph.front_end.step_track import StepTrack
from fbgraph.run.finding import Finding
from fbgraph.run.walk_result import WalkResult

_APART_S = 10.0  # what comes sooner after one another is told together
_REST_S = 3.0  # a longer time between two steps is a rest
_WEATHER_M, _WEATHER_M_S = 0.85, 7e-3  # three hectopascals an hour are no news
_MANY = 20  # steps
_NOISY_M = 0.5  # at a scatter like this no floor is told from the next


def altitude_findings(result: WalkResult) -> list[Finding]:
    """Rides, what pressure did by itself, and a barometer too unsteady for altitude."""
    track = result.track
    return [*_rides(track), *_leaps(track), *_rests(track), *_unsteady(track), *_silence(result)]


def _rides(track: StepTrack) -> list[Finding]:
    """Each with the height between the breadcrumbs at its ends."""
    found = []
    for run in _runs(track, track.carried_m != 0.0):
        rise_m = float(track.carried_m[run].sum())
        start_s, end_s = float(track.t_s[run[0] - 1]), float(track.start_s[run[-1]])
        text = (
            f"the altitude changed by {rise_m:+.1f} m without a step (between steps {run[0] - 1} and {run[-1]}): "
            "a lift or an escalator"
        )
        found.append(Finding("lift", start_s, end_s, text))
    return found


def _leaps(track: StepTrack) -> list[Finding]:
    """While walking, in air that is steady otherwise: faster than legs."""
    walking = np.diff(track.t_s, prepend=track.t_s[0]) < _REST_S
    found = []
    for run in _runs(track, walking & (track.blown_m != 0.0) & ~_gusty(track) & ~_noisy(track)):
        start_s, end_s = float(track.start_s[run[0]]), float(track.t_s[run[-1]])
        net_m, largest_m = float(track.blown_m[run].sum()), float(np.abs(track.blown_m[run]).max())
        if len(run) >= _MANY and abs(net_m) > _MANY * _NOISY_M:
            text = (
                f"air pressure changed for {end_s - start_s:.0f} s as on a climb of {net_m:+.0f} m, faster than legs "
                "climb: not followed, and altitude is uncertain by as much"
            )
        elif largest_m < _WEATHER_M:
            continue
        else:
            text = (
                f"air pressure leapt by up to {largest_m:.1f} m of altitude at {len(run)} "
                f"step{'' if len(run) == 1 else 's'}: a door, a gust or a finger on the sensor, not followed"
            )
        found.append(Finding("pressure", start_s, end_s, text))
    return found


def _rests(track: StepTrack) -> list[Finding]:
    """Pressure that changed while nobody stepped, with no ride in it, and by more than weather does."""
    passed_s = np.diff(track.t_s, prepend=track.t_s[0])
    changed = (passed_s >= _REST_S) & (np.abs(track.blown_m) > _WEATHER_M + _WEATHER_M_S * passed_s)
    return [
        Finding(
            "pressure",
            float(track.t_s[k - 1]),
            float(track.t_s[k]),
            f"air pressure changed by {track.blown_m[k]:+.1f} m of altitude while nobody stepped and nothing rode: "
            "a door, ventilation or the weather, not followed",
        )
        for k in np.flatnonzero(changed).tolist()
    ]


def _unsteady(track: StepTrack) -> list[Finding]:
    """Gusts and noise."""
    sigma_m = track.altitude_sigma_m
    found = []
    for name, which, cause in (
        ("goes to and fro", _gusty(track), "wind or a draught on the sensor"),
        ("is noisy", _noisy(track), "too noisy a barometer for altitude, or gusts"),
    ):
        runs = [run for run in _runs(track, which) if len(run) >= _MANY]
        if runs:
            steps = np.concatenate(runs)
            text = (
                f"air pressure {name} by ±{np.median(sigma_m[steps]):.1f} m of altitude (1σ) over {len(steps)} steps: "
                f"{cause}; no slope is read from it, and altitude is uncertain"
            )
            found.append(Finding("pressure", float(track.start_s[steps[0]]), float(track.t_s[steps[-1]]), text))
    return found


def _gusty(track: StepTrack) -> BoolArray:
    return np.asarray(track.gusty != 0.0)


def _noisy(track: StepTrack) -> BoolArray:
    """For many steps on end: the scatter of a single leap lasts for some seconds too."""
    noisy = ~_gusty(track) & (track.altitude_sigma_m > _NOISY_M)
    many = np.zeros(len(track), dtype=bool)
    for run in _runs(track, noisy):
        many[run] = len(run) >= 2 * _MANY
    return many


def _silence(result: WalkResult) -> list[Finding]:
    """A barometer that stopped, or came late."""
    track, pressure = result.track, result.log.pressure
    if len(pressure) == 0 or not np.isfinite(track.altitude_m).any():
        return []
    runs = [run for run in _runs(track, np.isnan(track.altitude_m)) if len(run) >= _MANY]
    return [
        Finding(
            "pressure",
            float(track.start_s[run[0]]),
            float(track.t_s[run[-1]]),
            f"the barometer said nothing new for {len(run)} steps (missing, or frozen at one value): altitude is "
            "unknown there",
        )
        for run in runs
    ]


def _runs(track: StepTrack, which: BoolArray) -> list[list[int]]:
    """Indices of the steps of which it is true, those close together in time as one list."""
    at = np.flatnonzero(which).tolist()
    cuts = [i + 1 for i, (a, b) in enumerate(itertools.pairwise(at)) if track.start_s[b] - track.t_s[a] > _APART_S]
    edges = [0, *cuts, len(at)]
    return [at[lo:hi] for lo, hi in itertools.pairwise(edges) if hi > lo]
