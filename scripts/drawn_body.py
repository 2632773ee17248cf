"""Kinds of walks: how one goes, how the device is carried, and what its sensors and its clock get wrong."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from drawn import Case, Kind, adding_to, between, corners, direction, loop, moment, path, sign, usual, walked
from numpy.random import Generator

from fbgraph.core.geometry import FloatArray
from fbgraph.core.units import DEGREE_RAD, STANDARD_GRAVITY_M_S2
from fbgraph.simulator import disturbances as done
from fbgraph.simulator.gait import Walker
from fbgraph.simulator.simulate import SimulatedWalk
from fbgraph.simulator.simulate_options import Device

KINDS: list[Kind] = []
kind = adding_to(KINDS)


# ------------------------------------------------------------------------------------------------------------- gait
def partly(rng: Generator, walker: Walker, low_m: float, high_m: float, said: str) -> Case:
    """As usual, then some way in another gait, then as usual; straight on, or with corners in either usual part."""
    first, last = corners(rng, 2), corners(rng, 2)
    heading = first[-1] - first[-2]
    heading /= np.hypot(*heading)
    out = first[-1] + rng.uniform(low_m, high_m) * heading
    before = last[1] / np.hypot(*last[1])
    cos, sin = before @ heading, before[0] * heading[1] - before[1] * heading[0]
    turn = np.array([(cos, -sin), (sin, cos)])
    points = [*first, out, *(out + last[1:] @ turn.T)]
    walk = walked(rng, path(points, {2: 1.0, 3: 1.0}), gaits={2: walker, 3: Walker()})
    return Case(walk, f"{np.hypot(*(out - first[-1])):.0f} m {said}")


@kind("running", share=1.5)
def _(rng: Generator) -> Case:
    hz, length = rng.uniform(2.6, 3.2), rng.uniform(0.9, 1.3)
    bounce = rng.uniform(6.0, 10.0)
    runner = Walker(cadence_hz=hz, alpha_m=length - 0.2 * hz, bounce_m_s2=bounce, sway_deg=rng.uniform(2.5, 4.0))
    return partly(rng, runner, 40.0, 140.0, f"at {hz:.2f} Hz, {length:.2f} m a step")


@kind("slow", share=1.5)
def _(rng: Generator) -> Case:
    slow = Walker(cadence_hz=rng.uniform(0.7, 1.0), bounce_m_s2=rng.uniform(0.4, 0.9), sway_deg=rng.uniform(1.0, 2.5))
    return partly(rng, slow, 15.0, 50.0, f"at {slow.cadence_hz:.2f} Hz")


@kind("trolley", share=1.5)
def _(rng: Generator) -> Case:
    pushing = Walker(bounce_m_s2=rng.uniform(0.2, 0.5), sway_deg=rng.uniform(0.4, 2.5))
    return partly(rng, pushing, 20.0, 60.0, f"of bounce {pushing.bounce_m_s2:.2f} m/s²")


@kind("bouts of a few steps", share=1.5)
def _(rng: Generator) -> Case:
    bouts, lengths = int(rng.integers(10, 41)), []
    for _bout in range(bouts):
        lengths.append(0.71 * int(rng.integers(2, 5)) * rng.uniform(0.97, 1.0))
    turns = np.cumsum(np.where(rng.random(bouts) < 0.1, np.pi / 2, 0.0) * rng.choice((-1.0, 1.0), bouts))
    steps = np.array(lengths)[:, None] * np.column_stack((np.cos(turns), np.sin(turns)))
    points = np.concatenate((np.zeros((1, 2)), np.cumsum(steps, axis=0)))
    pauses = dict(enumerate(rng.uniform(1.5, 5.0, bouts + 1).tolist()))
    return Case(walked(rng, path(points, pauses)), f"{bouts} bouts, {sum(lengths):.0f} m")


# -------------------------------------------------------------------------------------------------------- no walking
def standing(rng: Generator) -> tuple[SimulatedWalk, float, float]:
    """A walk with a stop, when that begins and how long it lasts."""
    way, rest = corners(rng), rng.uniform(30.0, 90.0)
    stop = int(rng.integers(1, len(way) - 1))
    walk = walked(rng, path(way, {stop: rest}))
    return walk, float(walk.checkpoints.t_s[stop] - walk.log.t0_s), rest


@kind("gestures", share=1.5)
def _(rng: Generator) -> Case:
    walk, since, rest = standing(rng)
    starts = since + 2.0 + np.arange(0.0, rest - 12.0, rng.uniform(9.0, 15.0))
    bursts = [
        done.Burst(float(start), rng.uniform(3.0, 7.0), rng.uniform(1.5, 2.5), rng.uniform(0.02, 0.045))
        for start in starts
    ]
    return Case(done.gestures(walk, bursts), f"{len(bursts)} bursts")


@kind("vibration")
def _(rng: Generator) -> Case:
    walk, since, rest = standing(rng)
    hz, size = between(rng, 3.0, 12.0), between(rng, 0.3, 3.0)
    return Case(
        done.vibration(walk, since + 2.0, rest - 4.0, size, hz, rng), f"{size:.1f} m/s² at {hz:.1f} Hz for {rest:.0f} s"
    )


# ---------------------------------------------------------------------------------------------------------- carrying
@kind("turned in the hand", share=1.5)
def _(rng: Generator) -> Case:
    walk = usual(rng)
    angle, at = sign(rng) * rng.uniform(30.0, 180.0), moment(rng, walk)
    return Case(done.turned_in_hand(walk, angle * DEGREE_RAD, at), f"by {angle:.0f}° at {at:.0f} s")


@kind("turned in the hand twice")
def _(rng: Generator) -> Case:
    walk = usual(rng)
    first, at = sign(rng) * rng.uniform(30.0, 180.0), moment(rng, walk, 0.15, 0.4)
    second, then = -first if rng.random() < 0.6 else rng.uniform(-180.0, 180.0), moment(rng, walk, 0.6, 0.85)
    walk = done.turned_in_hand(done.turned_in_hand(walk, first * DEGREE_RAD, at), second * DEGREE_RAD, then)
    return Case(walk, f"by {first:.0f}° at {at:.0f} s, by {second:.0f}° at {then:.0f} s")


@kind("mounted turned", share=1.5)
def _(rng: Generator) -> Case:
    yaw, tilt = sign(rng) * rng.uniform(90.0, 180.0), float(rng.choice((0.0, 20.0, 75.0)))
    rate = float(rng.choice((25.0, 50.0, 100.0)))
    device = Device(tilt_deg=tilt, mount_yaw_deg=yaw, rate_hz=rate)
    return Case(walked(rng, path(corners(rng)), device=device), f"by {yaw:.0f}°, tilted {tilt:.0f}°")


# ------------------------------------------------------------------------------------------------ sensors and clocks
def spoiled(rng: Generator, change: Callable[[SimulatedWalk], SimulatedWalk], said: str) -> Case:
    return Case(change(walked(rng, path(loop(rng)))), said, as_file=True)


@kind("axes swapped", share=1.5)
def _(rng: Generator) -> Case:
    sensor, order = str(rng.choice(("acc", "gyro", "mag"))), rng.choice(3, 2, replace=False)
    matrix = np.eye(3)
    matrix[order] = matrix[order[::-1]]
    named = "↔".join("xyz"[axis] for axis in sorted(order.tolist()))
    return spoiled(rng, lambda walk: done.mixed(walk, sensor, matrix), f"{sensor} {named}")


@kind("axes negated", share=1.5)
def _(rng: Generator) -> Case:
    sensor, axis = str(rng.choice(("acc", "gyro", "mag"))), int(rng.integers(4))
    signs = -np.ones(3) if axis == 3 else 1.0 - 2.0 * (np.arange(3) == axis)
    return spoiled(rng, lambda walk: done.mixed(walk, sensor, np.diag(signs)), f"{sensor} {(*'xyz', 'all')[axis]}")


@kind("a sensor freezes")
def _(rng: Generator) -> Case:
    sensor, share, length = str(rng.choice(done.SENSORS)), rng.uniform(0.15, 0.8), between(rng, 2.0, 300.0)

    def change(walk: SimulatedWalk) -> SimulatedWalk:
        start = share * walk.log.duration_s
        return done.frozen(walk, sensor, start, start + length)

    return spoiled(rng, change, f"{sensor} for {length:.0f} s at {share:.0%}")


@kind("spikes")
def _(rng: Generator) -> Case:
    sensor, share, factor = str(rng.choice(done.SENSORS)), between(rng, 1e-3, 0.03), between(rng, 0.3, 3.0)
    size = factor * {"acc": 3.0 * STANDARD_GRAVITY_M_S2, "gyro": 8.0, "mag": 100.0, "pressure": 30.0}[sensor]
    return spoiled(rng, lambda walk: done.spikes(walk, sensor, share, size, rng), f"{sensor} {share:.1%} of {size:.0f}")


@kind("the clock runs wrong")
def _(rng: Generator) -> Case:
    factor = between(rng, 0.9, 1.2)
    return spoiled(rng, lambda walk: done.clock_runs(walk, factor), f"x {factor:.3f}")


@kind("a gap")
def _(rng: Generator) -> Case:
    length, share = between(rng, 1.0, 60.0), rng.uniform(0.1, 0.6)
    return spoiled(
        rng, lambda walk: done.gap(walk, share * walk.log.duration_s, length), f"{length:.0f} s at {share:.0%}"
    )


@kind("barometer drifts fast")
def _(rng: Generator) -> Case:
    hpa = sign(rng) * between(rng, 5.0, 20.0)  # slower, it is a slope
    walk = walked(rng, path(loop(rng)))
    return Case(done.weather(walk, hpa * 3600.0 / walk.log.duration_s), f"{hpa:.1f} hPa in all")


@kind("two things at once", share=2.0)
def _(rng: Generator) -> Case:
    walk = usual(rng)
    changes: tuple[tuple[str, Callable[[SimulatedWalk], SimulatedWalk]], ...] = (
        ("hard iron", lambda w: done.offset(w, "mag", between(rng, 2.0, 40.0) * direction(rng))),
        ("recalibration", lambda w: done.offset(w, "mag", between(rng, 5.0, 40.0) * direction(rng), moment(rng, w))),
        ("weather", lambda w: done.weather(w, sign(rng) * between(rng, 0.5, 3.0))),
        ("door", lambda w: done.door_pulses(w, [moment(rng, w)], between(rng, 0.3, 1.5), 1.5)),
        ("wind", lambda w: done.wind(w, between(rng, 0.05, 0.4), 1.0, rng)),
        ("turned", lambda w: done.turned_in_hand(w, sign(rng) * rng.uniform(0.5, 3.0), moment(rng, w))),
        ("gyro scale", lambda w: done.mixed(w, "gyro", scaled(rng))),
        ("gyro bias", lambda w: done.offset(w, "gyro", between(rng, 0.005, 0.05) * direction(rng), moment(rng, w))),
    )
    first, second = sorted(rng.choice(len(changes), 2, replace=False).tolist())
    for _name, change in (changes[first], changes[second]):
        walk = change(walk)
    return Case(walk, f"{changes[first][0]}, {changes[second][0]}")


def scaled(rng: Generator) -> FloatArray:
    return np.asarray((1.0 + rng.uniform(-0.04, 0.04)) * np.eye(3))
