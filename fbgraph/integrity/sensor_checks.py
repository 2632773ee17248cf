"""Sensors by themselves and against one another: stuck, silent, cut off, out of scale, or turned the wrong way.

What undisturbed walks show was measured on 88 real logs (IPIN 2023, indoor-location) and 60 simulated walks; limits
stand well beyond the most that any of them shows, and a reason's weight is how many times its limit was passed.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from fbgraph.core.geometry import FloatArray
from fbgraph.core.sensor_log import Stream
from fbgraph.core.units import STANDARD_GRAVITY_M_S2
from fbgraph.core.verdict import Reason
from fbgraph.front_end.step_track import MIN_RATE_HZ
from fbgraph.integrity.compass_checks import compass_against_gyroscope
from fbgraph.integrity.evidence import UNKNOWN_TURN_RAD, Doubt, Sensed, stepping, stretched_m, turned_m

NAMES = {"acc": "accelerometer", "gyro": "gyroscope", "mag": "magnetometer", "pressure": "barometer"}

_FROZEN_S = {"acc": 1.0, "gyro": 1.0}  # undisturbed: 0.02 s at most
_FROZEN_MAG_S = 3.0  # undisturbed: 1.5 s, of phones whose compass shows tenths of µT
_STEP_S = 0.5  # about
_FASTEST_M_S = 1.5  # while nothing counted steps somebody may have walked on
_MOVING_RAD_S, _MOVING_M_S2 = 0.1, 0.5  # what the other sensor must have moved, peak to peak
_SILENT_S = 3.0  # devices end their streams within a second of one another
_RAIL_SHARE = 0.002  # of samples at one value beyond which none lies; undisturbed: 0.0002
_RAIL_NEAR = 0.98
_RAIL_SAMPLES = 5  # three of 800 meet there by chance once in some thousand walks: sensors have a resolution
_GRAVITY_REL = 0.05  # undisturbed: 3.5 % (a bias of three sigma, 10 mg each)
_LEVEL_BLOCK_S = 2.0  # some four steps: what pushes forward and back in them cancels
_LEVEL_RMS_M_S2 = 1.0  # undisturbed: 0.7
_LEVEL_BLOCK_M_S2 = 1.6  # of one block; undisturbed: 1.42
_LEVEL_LOST_M_S2 = 2.0  # level is lost by twelve degrees, which a sound compass may make up for
_LEVEL_GONE_M_S2 = 4.0  # by 24 nothing can: headings of both are taken about another axis
_LEVEL_WALKED = 0.8  # of a block
_SETTLED_S = 5.0  # levelling itself takes its time constant
_NOISE = {"acc": 2.5, "gyro": 0.5}  # of a sample, SI; undisturbed: 0.46 and 0.075
_NOISE_RATE_HZ = 25.0  # slower, and a step itself changes as much from sample to sample
_SPARSE_S, _SPARSE_SHARE = (0.15, 0.5), 0.2  # between samples: a step's peak is missed; a gap is told otherwise
_FIRST = 10.0  # told before what follows from it
_LATE_S = 0.4  # of samples left out as they came too late; 30 ms of jitter leave out half of that
_CORNER_RAD_S = 0.5  # somebody who walks round a corner may turn like this, one sigma
_STUCK_S = 5.0  # even lying on a table a sensor shows its noise
_LIMP_RAD_S = 0.05  # a hand or a body that walks tilts by 0.17 rad/s or more


def frozen_sensors(walk: Sensed) -> list[Doubt]:
    """An inertial sensor that repeats one sample while the other one moves: it hangs, whatever it says."""
    found = []
    for name, other, moves in (("acc", "gyro", _MOVING_RAD_S), ("gyro", "acc", _MOVING_M_S2)):
        stream, limit_s = getattr(walk.log, name), _FROZEN_S[name]
        for start_s, end_s in _repeats(stream, limit_s):
            around = getattr(walk.log, other).between(start_s, end_s)
            moved = len(around) > 1 and np.ptp(around.values, axis=0).max() >= moves
            if not moved and end_s - start_s < _STUCK_S:
                continue
            text = f"the {NAMES[name]} repeats one sample from {start_s:.1f} to {end_s:.1f} s"
            text += f", while the {NAMES[other]} moves" if moved else ""
            advice = "the sensor or its bus hangs: restart the device and walk again"
            if name == "gyro":
                sigma_m = turned_m(walk.track, UNKNOWN_TURN_RAD, start_s)
            else:
                sigma_m = _unseen_m(walk, start_s, end_s)
            reason = Reason(NAMES[name], (end_s - start_s) / limit_s, text, advice, start_s, end_s)
            found.append(Doubt(reason, sigma_m))
    return sorted(found, key=lambda doubt: -doubt.reason.weight)[:1]


def frozen_magnetometer(walk: Sensed) -> list[Doubt]:
    """A magnetometer that repeats one sample while steps are taken: for all that it knows, nobody ever turns."""
    found = []
    for start_s, end_s in _repeats(walk.log.mag, _FROZEN_MAG_S):
        steps = int(((walk.track.t_s > start_s) & (walk.track.t_s < end_s)).sum())
        if steps * _STEP_S < _FROZEN_MAG_S:
            continue
        text = f"the magnetometer repeats one sample from {start_s:.1f} to {end_s:.1f} s, for {steps} steps"
        advice = "the sensor or its bus hangs: restart the device and walk again"
        reason = Reason(NAMES["mag"], (end_s - start_s) / _FROZEN_MAG_S, text, advice, start_s, end_s)
        found.append(Doubt(reason, turned_m(walk.track, UNKNOWN_TURN_RAD, start_s)))
    return sorted(found, key=lambda doubt: -doubt.reason.weight)[:1]


def silent_sensors(walk: Sensed) -> list[Doubt]:
    """An inertial sensor that fell silent before the others: the walk is cut off there, and nobody would know."""
    log, found = walk.log, []
    end_s = max(stream.t_s[-1] for stream in (log.acc, log.gyro, log.mag, log.pressure) if len(stream))
    for name in ("acc", "gyro"):
        stream = getattr(log, name)
        missing_s = float(end_s - stream.t_s[-1])
        if name == "acc":  # readers keep what the others said in the accelerometer's time only
            missing_s = max(missing_s, log.counts.get("gyro_stray_time", 0) / max(log.gyro.rate_hz, 1.0))
        if missing_s > _SILENT_S and not any("time jumps" in notice for notice in log.notices):
            text = f"the {NAMES[name]} fell silent at {stream.t_s[-1]:.0f} s, {missing_s:.0f} s before the log ends"
            advice = "what was walked after that is missing: look at the device's wiring and storage, and walk again"
            found.append(Doubt(Reason(NAMES[name], missing_s / _SILENT_S, text, advice, float(stream.t_s[-1]))))
    return found


def cut_off_values(walk: Sensed) -> list[Doubt]:
    """Samples that pile up at one extreme value: the sensor's range is too small, or a bit of it is lost."""
    found = []
    for name, scale, unit in (("acc", 1.0, "m/s²"), ("gyro", np.degrees(1.0), "°/s")):
        stream = getattr(walk.log, name)
        rail, share = _rail(stream.values)
        if share <= _RAIL_SHARE:
            continue
        text = f"{100.0 * share:.1f} % of the {NAMES[name]}'s samples lie at {rail * scale:.4g} {unit}, none beyond it"
        advice = "its range is set too small, or samples are corrupted: set a wider range"
        if name == "gyro":  # what was cut off a turn is missing from it
            sigma_m = turned_m(walk.track, min(1.0, 10.0 * share))
        else:  # a step is missed, or its bounce is
            sigma_m = stretched_m(walk.track, min(0.3, 20.0 * share))
        found.append(Doubt(Reason(NAMES[name], share / _RAIL_SHARE, text, advice), sigma_m))
    return found


def noisy_sensors(walk: Sensed) -> list[Doubt]:
    """Noise from sample to sample beyond what any movement makes."""
    found = []
    for name, scale, unit in (("acc", 1.0, "m/s²"), ("gyro", np.degrees(1.0), "°/s")):
        stream = getattr(walk.log, name)
        if len(stream) < 10 or stream.rate_hz < _NOISE_RATE_HZ or (noise := _noise(stream.values)) <= _NOISE[name]:
            continue
        text = f"the {NAMES[name]}'s noise is {noise * scale:.2g} {unit} from one sample to the next"
        advice = "it is broken, or its supply or bus is: look at the raw sensors in the recording"
        sigma_m = stretched_m(walk.track, 0.4) if name == "acc" else turned_m(walk.track, 0.5)
        found.append(Doubt(Reason(NAMES[name], noise / _NOISE[name], text, advice), sigma_m))
    return found


def sparse_samples(walk: Sensed) -> list[Doubt]:
    """Too few samples to see every step."""
    found = []
    for name in ("acc", "gyro"):
        gaps_s = np.diff(getattr(walk.log, name).t_s)
        low_s, gap_s = _SPARSE_S
        share = float(gaps_s[(gaps_s > low_s) & (gaps_s < gap_s)].sum() / max(gaps_s[gaps_s < gap_s].sum(), 1e-9))
        if share <= _SPARSE_SHARE:
            continue
        text = f"{100.0 * share:.0f} % of the time the {NAMES[name]} has fewer than {1.0 / low_s:.0f} samples a second"
        advice = "steps and turns are missed: record at 20 Hz or more, and look for what loses samples"
        sigma_m = stretched_m(walk.track, min(share, 0.5)) + turned_m(walk.track, 0.3 * share)
        found.append(Doubt(Reason(NAMES[name], share / _SPARSE_SHARE, text, advice), sigma_m))
    return found


def too_slow(walk: Sensed) -> list[Doubt]:
    """Samples so far apart that no rhythm can be told from another: what is counted then may be anything."""
    rate_hz = walk.log.acc.rate_hz
    if not rate_hz < MIN_RATE_HZ:
        return []
    text = f"the accelerometer runs at {rate_hz:.3g} Hz, too slow for steps"
    advice = "record at 20 Hz or more, or check the unit of the time column"
    weight = _FIRST * MIN_RATE_HZ / rate_hz
    return [Doubt(Reason(NAMES["acc"], weight, text, advice), withhold=True)]


def clock_set(walk: Sensed) -> list[Doubt]:
    """A clock that began anew or was set back: what was walked and turned meanwhile is missing."""
    restarts = walk.log.counts.get("clock_restarts", 0)
    late_s = walk.log.counts.get("acc_not_later", 0) / max(walk.log.acc.rate_hz, 1.0)
    if restarts:
        text = f"the device's clock restarted {restarts} times during the log, how long it was off is not known"
        advice = "what was walked and turned meanwhile is missing: look for what switches it off"
        return [Doubt(Reason("clock", 1.0, text, advice), turned_m(walk.track, 0.2))]
    if late_s <= _LATE_S:
        return []
    text = f"the clock was set back: samples of {late_s:.1f} s came before those already there and were left out"
    advice = "what was turned meanwhile is missing: let nothing set the clock during a walk"
    turn_rad = min(late_s, 2.0) * _CORNER_RAD_S
    return [Doubt(Reason("clock", late_s / _LATE_S, text, advice), turned_m(walk.track, turn_rad))]


def gravitys_size(walk: Sensed) -> list[Doubt]:
    """The vertical acceleration over whole strides is gravity, whoever walks."""
    blocks = level_blocks(walk)
    if len(blocks.t_s) < 3:
        return []
    gravity = float(np.median(blocks.acc_m_s2[:, 2]))
    off = gravity / STANDARD_GRAVITY_M_S2 - 1.0
    if abs(off) <= _GRAVITY_REL or level_error(blocks) > _LEVEL_RMS_M_S2:  # of a level that is lost, nothing follows
        return []
    text = f"the accelerometer shows a gravity of {gravity:.2f} m/s² where there is 9.81"
    advice = "its scale or range is wrong: check the unit, or calibrate it"
    # a step's length goes with the root of its surge, a third of it all; what it takes to count one with the bounce
    sigma_m = stretched_m(walk.track, 0.25 * abs(np.log(max(gravity, 1.0) / STANDARD_GRAVITY_M_S2)))
    return [Doubt(Reason("accelerometer", abs(off) / _GRAVITY_REL, text, advice), sigma_m)]


def gravity_against_gyroscope(walk: Sensed) -> list[Doubt]:
    """Levelled by the gyroscope, what is left of the acceleration is level only if both agree how the device turns.

    Over a few steps pushes cancel; an axis swapped or mirrored, a gyroscope that hangs, spikes or drifts tilts the
    levelled frame, and gravity leaks into the horizontal.
    """
    blocks = level_blocks(walk)
    if len(blocks.t_s) < 5:
        return []
    off_m_s2 = np.hypot(blocks.acc_m_s2[:, 0], blocks.acc_m_s2[:, 1])
    rms, beyond = level_error(blocks), off_m_s2 > _LEVEL_BLOCK_M_S2
    if rms <= _LEVEL_RMS_M_S2 and beyond.sum() < 2:
        return []
    bad = blocks.t_s[beyond] if beyond.any() else blocks.t_s
    start_s, end_s = float(bad[0] - _LEVEL_BLOCK_S / 2), float(bad[-1] + _LEVEL_BLOCK_S / 2)
    tilt_deg = float(np.degrees(np.arcsin(min(np.percentile(off_m_s2, 90) / STANDARD_GRAVITY_M_S2, 1.0))))
    text = (
        f"accelerometer and gyroscope contradict each other about which way is down, by up to {tilt_deg:.0f}° "
        f"from {start_s:.0f} to {end_s:.0f} s"
    )
    advice = "an axis of one of them is swapped or mirrored, or it drifts, hangs or is full of noise: check both"
    # what is wrong all along was wrong where nobody turned, too
    since_s = start_s if rms <= _LEVEL_RMS_M_S2 else -np.inf
    sigma_m = turned_m(walk.track, 3.0 * np.radians(tilt_deg), since_s)
    reason = Reason(
        "gyroscope", max(rms / _LEVEL_RMS_M_S2, off_m_s2.max() / _LEVEL_BLOCK_M_S2), text, advice, start_s, end_s
    )
    # without a third to ask, or with one that contradicts too, nothing is left to go by
    alone = not np.isfinite(walk.track.yaw_mag_rad).any() or bool(compass_against_gyroscope(walk))
    return [Doubt(reason, sigma_m, withhold=rms > (_LEVEL_LOST_M_S2 if alone else _LEVEL_GONE_M_S2))]


def limp_gyroscope(walk: Sensed) -> list[Doubt]:
    """Whoever walks tilts the device at every step, however it is worn."""
    inside = stepping(walk)
    if inside.sum() < 100:
        return []
    tilting = float(np.sqrt((walk.signals.tilt_rate_rad_s[inside] ** 2).mean()))
    if tilting >= _LIMP_RAD_S:
        return []
    text = (
        f"the gyroscope hardly moves while steps are counted: {np.degrees(tilting):.2f} °/s, a walker's 10 °/s or more"
    )
    advice = "its unit is wrong, it is switched off, or nobody carried the device and what shook it was no walk"
    return [Doubt(Reason("gyroscope", _LIMP_RAD_S / max(tilting, 1e-3), text, advice), withhold=True)]


@dataclass(frozen=True)
class LevelBlocks:
    """Means over ``_LEVEL_BLOCK_S``: their middle times (N,) and the levelled acceleration (N, 3)."""

    t_s: FloatArray
    acc_m_s2: FloatArray


def level_blocks(walk: Sensed) -> LevelBlocks:
    """Mean acceleration in blocks of whole strides; blocks that were not walked, or have holes, are left out.

    Where somebody shakes or throws the device, pushes do not cancel.
    """
    signals, t_s = walk.signals, walk.signals.t_s
    if len(t_s) < 2:
        return LevelBlocks(np.empty(0), np.empty((0, 3)))
    block = np.floor(t_s / _LEVEL_BLOCK_S).astype(np.int64)
    first = np.flatnonzero(np.diff(block, prepend=block[0] - 1))
    count = np.diff(np.append(first, len(t_s)))
    acc = np.add.reduceat(signals.acc_n_m_s2, first) / count[:, None]
    walked = np.add.reduceat(stepping(walk).astype(float), first) / count
    middle_s = (block[first] + 0.5) * _LEVEL_BLOCK_S
    keep = (count > 0.8 * np.median(count)) & (walked > _LEVEL_WALKED)
    keep &= middle_s - _LEVEL_BLOCK_S / 2 > t_s[0] + _SETTLED_S
    return LevelBlocks(middle_s[keep], acc[keep])


def level_error(blocks: LevelBlocks) -> float:
    """Root mean square of the horizontal acceleration, m/s²."""
    return float(np.sqrt((blocks.acc_m_s2[:, :2] ** 2).sum(axis=1).mean())) if len(blocks.t_s) else 0.0


def _repeats(stream: Stream, limit_s: float) -> list[tuple[float, float]]:
    """Begin and end of every stretch longer than ``limit_s`` of one and the same sample."""
    if len(stream) < 2:
        return []
    same = (stream.values[1:] == stream.values[:-1]).all(axis=1)
    edges = np.flatnonzero(np.diff(np.concatenate(([False], same, [False])).astype(np.int8)))
    spans = zip(stream.t_s[edges[::2]].tolist(), stream.t_s[edges[1::2]].tolist(), strict=True)
    return [(start_s, end_s) for start_s, end_s in spans if end_s - start_s > limit_s]


def _unseen_m(walk: Sensed, start_s: float, end_s: float) -> FloatArray:
    """(K+1,) how far somebody may have gone meanwhile, one sigma, for the breadcrumbs after it."""
    return np.where(walk.track.t_s > start_s, _FASTEST_M_S * (end_s - start_s) / np.sqrt(2.0), 0.0)


def _noise(values: FloatArray) -> float:
    """Standard deviation of a sample's noise on the worst axis, robust, from second differences."""
    second = np.abs(values[:-2] - 2.0 * values[1:-1] + values[2:])
    return float(np.median(second, axis=0).max() / (0.6745 * np.sqrt(6.0)))


def _rail(values: FloatArray) -> tuple[float, float]:
    """The extreme value of an axis at which samples pile up, and their share of all; (0, 0) if there is none.

    It must occur more often than all that lies in the 2 % below it, and be an extreme of motion, not of rest.
    """
    rail, share = 0.0, 0.0
    for axis in (*values.T, *-values.T):
        extreme = float(axis.max())
        there = int((axis == extreme).sum())
        near = int((axis >= _RAIL_NEAR * extreme).sum())
        if extreme > 0.0 and there >= _RAIL_SAMPLES and there > near / 2 and there / len(axis) > share:
            rail, share = extreme, there / len(axis)
    return rail, share
