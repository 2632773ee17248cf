"""Kinds of walks: nothing wrong, and what lies outside of the wearer: places told, magnetic field, air, rests."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
from drawn import Case, Kind, adding_to, between, corners, direction, loop, moment, path, sign, someone, usual, walked
from numpy.random import Generator

from fbgraph.core.aids import Told
from fbgraph.core.units import DEGREE_RAD
from fbgraph.simulator import disturbances as done
from fbgraph.simulator.gait import Walker
from fbgraph.simulator.routes import load_route
from fbgraph.simulator.simulate import SimulatedWalk, simulate
from fbgraph.simulator.simulate_options import Device

KINDS: list[Kind] = []
kind = adding_to(KINDS)

NAMED = ("square", "eight", "out-and-back", "stairs", "obstacle", "straight")


# ------------------------------------------------------------------------------------------------ nothing is wrong
@kind("undisturbed", share=9.0, quiet=True)
def _(rng: Generator) -> Case:
    if rng.random() < 0.5:
        name = str(rng.choice(NAMED))
        route = load_route(name, laps=int(rng.integers(1, 4)) if name in ("square", "eight", "obstacle") else 1)
    else:
        route = path(corners(rng) if rng.random() < 0.6 else loop(rng))
    rate = float(rng.choice((20.0, 25.0, 50.0, 100.0, 200.0), p=(0.2, 0.3, 0.3, 0.15, 0.05)))
    options = someone(rng)
    options = replace(options, device=replace(options.device, rate_hz=rate))
    return Case(simulate(route, options, int(rng.integers(2**31))), f"{route.name}, {rate:g} Hz")


@kind("other cadence", share=2.0, quiet=True)
def _(rng: Generator) -> Case:
    walker = Walker(cadence_hz=rng.uniform(1.4, 2.3), bounce_m_s2=rng.uniform(1.2, 3.0), asymmetry=rng.uniform(0, 0.3))
    return Case(
        walked(rng, path(corners(rng)), walker=walker), f"{walker.cadence_hz:.2f} Hz, {walker.bounce_m_s2:.1f} m/s²"
    )


@kind("10 to 25 minutes", share=0.7, quiet=True)
def _(rng: Generator) -> Case:
    seconds = rng.uniform(600.0, 1500.0)
    route = path(rng.uniform(2.0, 6.0) * loop(rng))
    options = someone(rng, device=Device(rate_hz=20.0, mag_rate_hz=10.0, pressure_rate_hz=5.0), duration_s=seconds)
    return Case(simulate(route, options, int(rng.integers(2**31))), f"{seconds / 60:.0f} min")


def facing_east(walk: SimulatedWalk) -> SimulatedWalk:
    """Truth in the frame of a walk without a compass: its first direction is called East."""
    cos, sin = np.cos(walk.yaw_rad[0]), np.sin(walk.yaw_rad[0])
    return done.in_frame(walk, lambda xy_m: xy_m @ np.array([(cos, -sin), (sin, cos)]))


@kind("no magnetometer", quiet=True)
def _(rng: Generator) -> Case:
    return Case(facing_east(done.without(usual(rng), "mag")), "no magnetometer")


@kind("no barometer", quiet=True)
def _(rng: Generator) -> Case:
    return Case(done.without(usual(rng), "pressure"), "no barometer")


@kind("out and back", share=2.0, quiet=True)
def _(rng: Generator) -> Case:
    way = corners(rng, int(rng.integers(2, 5)))
    rest = rng.uniform(2.0, 40.0)
    return Case(walked(rng, path([*way, *way[-2::-1]], {len(way) - 1: rest})), f"rest of {rest:.0f} s")


@kind("closed and said so", quiet=True)
def _(rng: Generator) -> Case:
    return Case(walked(rng, path(loop(rng))), "closed", Told(closed_walk=True))


def survey(rng: Generator, walk: SimulatedWalk, frame: done.Frame, sigma_m: float, fewest: int = 2) -> Told:
    times = np.sort(rng.uniform(walk.steps.t_s[0], walk.steps.t_s[-1], int(rng.integers(fewest, 8))))
    errors = rng.normal(0.0, sigma_m, (len(times), 2))
    return Told(anchors=done.surveyed(walk, times, errors, frame))


def anchored(
    rng: Generator,
    frame: done.Frame,
    said: str,
    spoil: Callable[[Told], Told] = lambda told: told,
    fewest: int = 2,
) -> Case:
    walk = usual(rng)
    told = spoil(survey(rng, walk, frame, 0.35, fewest))
    count = 0 if told.anchors is None else len(told.anchors)
    return Case(done.in_frame(walk, frame), f"{count} anchors, {said}", told)


@kind("anchors", quiet=True)
def _(rng: Generator) -> Case:
    return anchored(rng, lambda xy_m: xy_m, "good")


@kind("anchors, their own sigma", quiet=True)
def _(rng: Generator) -> Case:
    walk, sigma = usual(rng), between(rng, 0.3, 6.0)
    told = survey(rng, walk, lambda xy_m: xy_m, sigma)
    assert told.anchors is not None
    told = Told(anchors=replace(told.anchors, sigma_m=np.full(len(told.anchors), sigma)))
    return Case(walk, f"{sigma:.1f} m", told)


@kind("anchors in UTM", quiet=True)
def _(rng: Generator) -> Case:
    east, north = rng.uniform(2e5, 8e5), rng.uniform(1e5, 9e6)
    return anchored(rng, lambda xy_m: xy_m + np.array([east, north]), f"at {east:.0f}, {north:.0f}")


# ------------------------------------------------------------------------------------------ anchors, closures, lanes
@kind("anchors, turned frame")
def _(rng: Generator) -> Case:
    angle = sign(rng) * between(rng, 5.0, 180.0) * DEGREE_RAD
    turn = np.array([(np.cos(angle), -np.sin(angle)), (np.sin(angle), np.cos(angle))])
    return anchored(rng, lambda xy_m: xy_m @ turn.T, f"turned by {angle / DEGREE_RAD:.0f}°")


@kind("anchors, swapped axes")
def _(rng: Generator) -> Case:
    return anchored(rng, lambda xy_m: xy_m[:, ::-1], "north first", fewest=5)  # fewer cannot tell a mirror from a turn


@kind("anchors, other unit")
def _(rng: Generator) -> Case:
    unit = float(rng.choice((0.001, 0.3048, 1.1, 3.2808, 100.0, 1000.0)))
    return anchored(rng, lambda xy_m: unit * xy_m, f"times {unit:g}", fewest=3)


@kind("anchors, one wrong")
def _(rng: Generator) -> Case:
    far = between(rng, 5.0, 60.0) * np.exp(2j * np.pi * rng.random())

    def spoil(told: Told) -> Told:
        assert told.anchors is not None
        wrong = np.arange(len(told.anchors)) == rng.integers(len(told.anchors))
        x_m, y_m = told.anchors.x_m + far.real * wrong, told.anchors.y_m + far.imag * wrong
        return Told(anchors=replace(told.anchors, x_m=x_m, y_m=y_m))

    return anchored(rng, lambda xy_m: xy_m, f"one {abs(far):.0f} m off", spoil)


@kind("said to be closed, and open")
def _(rng: Generator) -> Case:
    way = corners(rng)
    while np.hypot(*way[-1]) < 20.0:  # who ends nearer may well be at the start, for all that sensors tell
        way = corners(rng)
    walk = walked(rng, path(way))
    return Case(walk, f"ends {np.hypot(walk.x_m[-1], walk.y_m[-1]):.0f} m off", Told(closed_walk=True))


@kind("parallel lanes", share=1.5)
def _(rng: Generator) -> Case:
    apart, long, lanes = between(rng, 1.0, 4.0), rng.uniform(18.0, 35.0), int(rng.integers(3, 7))
    points = [(x * long, lane * apart) for lane in range(lanes) for x in ((0, 1) if lane % 2 == 0 else (1, 0))]
    return Case(walked(rng, path(points)), f"{lanes} lanes {apart:.1f} m apart")


# ----------------------------------------------------------------------------------------------------------- compass
@kind("hard iron", share=1.5)
def _(rng: Generator) -> Case:
    iron = between(rng, 2.0, 60.0) * direction(rng)
    return Case(done.offset(usual(rng), "mag", iron), f"{np.linalg.norm(iron):.0f} µT")


@kind("recalibration", share=1.5)
def _(rng: Generator) -> Case:
    walk, iron = usual(rng), between(rng, 5.0, 60.0) * direction(rng)
    at = moment(rng, walk, 0.1, 0.9)
    return Case(done.offset(walk, "mag", iron, at), f"{np.linalg.norm(iron):.0f} µT from {at:.0f} s on")


# ------------------------------------------------------------------------------------------------- rest and gyroscope
@kind("long rest", share=1.5)
def _(rng: Generator) -> Case:
    way, rest = corners(rng, int(rng.integers(2, 5))), between(rng, 60.0, 3600.0)
    back = [*way, *way[-2::-1]] if rng.random() < 0.5 else [*way, way[-1] + (0.0, 20.0), way[-1] + (20.0, 20.0)]
    options = someone(rng, device=Device(rate_hz=20.0, mag_rate_hz=8.0, pressure_rate_hz=4.0))
    walk = simulate(path(back, {len(way) - 1: rest}), options, int(rng.integers(2**31)))
    return Case(walk, f"{rest / 60:.1f} min")


def around(rng: Generator, with_compass: bool) -> Case:
    laps, side = int(rng.integers(3, 9)), rng.uniform(8.0, 16.0)
    points = side * np.array([(0, 0), (1, 0), (1, sign(rng)), (0, 1), (0, 0)])
    points[3, 1] = points[2, 1]
    walk = walked(rng, path(points).repeated(laps))
    scale = 1.0 + rng.uniform(-0.04, 0.04)
    walk = done.mixed(walk, "gyro", scale * np.eye(3))
    return Case(walk if with_compass else done.without(walk, "mag"), f"x {scale:.3f}, {laps} laps")


@kind("gyroscope's scale")
def _(rng: Generator) -> Case:
    return around(rng, with_compass=True)


@kind("gyroscope's scale, no compass")
def _(rng: Generator) -> Case:
    return around(rng, with_compass=False)


@kind("gyroscope's bias jumps")
def _(rng: Generator) -> Case:
    walk, by = usual(rng), between(rng, 0.3, 5.0)
    at = moment(rng, walk, 0.1, 0.9)
    return Case(done.offset(walk, "gyro", by * DEGREE_RAD * direction(rng), at), f"{by:.1f} °/s from {at:.0f} s on")


# --------------------------------------------------------------------------------------------------------- barometer
@kind("weather")
def _(rng: Generator) -> Case:
    rate = sign(rng) * between(rng, 0.5, 3.0)
    return Case(
        done.weather(walked(rng, path(loop(rng)), duration_s=rng.uniform(120.0, 500.0)), rate), f"{rate:.1f} hPa/h"
    )


@kind("lift", share=1.5)
def _(rng: Generator) -> Case:
    rise, speed, way = sign(rng) * between(rng, 3.0, 40.0), rng.uniform(0.7, 2.0), corners(rng)
    stop, seconds = int(rng.integers(1, len(way) - 1)), abs(rise) / speed + 2.0
    walk = walked(rng, path(way, {stop: seconds + rng.uniform(8.0, 30.0)}))
    at = walk.checkpoints.t_s[stop] - walk.log.t0_s + rng.uniform(2.5, 6.0)
    return Case(done.lift(walk, rise, at, seconds), f"{rise:.0f} m in {seconds:.0f} s")


@kind("doors")
def _(rng: Generator) -> Case:
    walk, hpa, length = usual(rng), sign(rng) * between(rng, 0.3, 1.5), rng.uniform(0.5, 3.0)
    at = rng.uniform(5.0, walk.log.duration_s - 5.0, int(rng.integers(1, 6)))
    return Case(done.door_pulses(walk, at.tolist(), hpa, length), f"{len(at)} of {hpa:.1f} hPa, {length:.1f} s")


@kind("wind")
def _(rng: Generator) -> Case:
    hpa, lasting = between(rng, 0.05, 0.6), between(rng, 0.3, 5.0)
    return Case(done.wind(usual(rng), hpa, lasting, rng), f"{hpa:.2f} hPa for {lasting:.1f} s")
