"""How the walks of ``integrity.py`` are drawn: by a seed, of one of the kinds of ``drawn_*.py``."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.random import Generator

from fbgraph.core.aids import Told
from fbgraph.core.geometry import FloatArray
from fbgraph.simulator.gait import Walker
from fbgraph.simulator.routes import Route
from fbgraph.simulator.simulate import SimulatedWalk, simulate
from fbgraph.simulator.simulate_options import Device, SimulateOptions


@dataclass(frozen=True)
class Case:
    """A walk, what was said of it, and what is wrong with it.

    Attributes:
        walk: log and exact truth, in the frame in which the result is given.
        said: what was done to it, for who looks at one walk.
        told: anchors, a closed end.
        preset: of the configuration.
        as_file: whether the log is to be read from a file, as a reader cleans and refuses.
    """

    walk: SimulatedWalk
    said: str
    told: Told = field(default_factory=Told)
    preset: str = "m5stickc"
    as_file: bool = False


@dataclass(frozen=True)
class Kind:
    """A kind of walk: how it is drawn, how often beside the others, and whether nothing is wrong with it."""

    name: str
    draw: Callable[[Generator], Case]
    share: float
    quiet: bool


Draw = Callable[[Generator], Case]


def adding_to(kinds: list[Kind]) -> Callable[..., Callable[[Draw], None]]:
    """A decorator ``(name, share=1.0, quiet=False)`` that puts kinds into a list."""

    def kind(name: str, share: float = 1.0, quiet: bool = False) -> Callable[[Draw], None]:
        return lambda draw: kinds.append(Kind(name, draw, share, quiet))

    return kind


def drawn(kinds: Sequence[Kind], seed: int, only: str = "") -> tuple[Kind, Case]:
    """The walk of a seed; of a kind if ``only`` names one."""
    rng = np.random.default_rng([11, seed])
    shares = np.array([kind.share * (only in ("", kind.name)) for kind in kinds])
    chosen = kinds[int(rng.choice(len(kinds), p=shares / shares.sum()))]
    return chosen, chosen.draw(rng)


def between(rng: Generator, low: float, high: float) -> float:
    """A number as likely to lie in any octave of a range."""
    return float(np.exp(rng.uniform(np.log(low), np.log(high))))


def sign(rng: Generator) -> float:
    return float(rng.choice((-1.0, 1.0)))


def path(points: Any, pauses: Mapping[int, float] | None = None) -> Route:
    """A route through points of the plan, (M, 2) or (M, 3), with pauses in seconds at some of them."""
    xyz_m = np.zeros((len(points), 3))
    xyz_m[:, : np.shape(points)[1]] = points
    pause_s = np.zeros(len(points))
    for waypoint, seconds in (pauses or {}).items():
        pause_s[waypoint] = seconds
    return Route("drawn", xyz_m, pause_s, tuple(str(k + 1) for k in range(len(points))))


def corners(rng: Generator, legs: int | None = None) -> FloatArray:
    """(M, 2) an open way of some legs, mostly with right angles."""
    legs = legs or int(rng.integers(3, 7))
    turns = np.where(rng.random(legs) < 0.7, np.pi / 2, rng.uniform(0.5, 2.2, legs)) * rng.choice((-1, 1), legs)
    headings = rng.uniform(-np.pi, np.pi) + np.cumsum(turns)
    lengths = rng.uniform(8.0, 35.0, legs)
    steps = lengths[:, None] * np.column_stack((np.cos(headings), np.sin(headings)))
    return np.concatenate((np.zeros((1, 2)), np.cumsum(steps, axis=0)))


def loop(rng: Generator) -> FloatArray:
    """(5, 2) round a rectangle, back to the start."""
    wide, high = rng.uniform(12.0, 40.0), sign(rng) * rng.uniform(10.0, 30.0)
    return np.array([(0, 0), (wide, 0), (wide, high), (0, high), (0, 0)])


def someone(rng: Generator, **changes: Any) -> SimulateOptions:
    """An ordinary wearer with an ordinary device, carried as it should be."""
    walker = Walker(cadence_hz=float(np.clip(rng.normal(1.8, 0.1), 1.6, 2.0)))
    device = Device(
        tilt_deg=float(rng.choice((20.0, 20.0, 0.0, 75.0))), rate_hz=float(rng.choice((25.0, 50.0, 50.0, 100.0)))
    )
    return replace(SimulateOptions(walker=walker, device=device), **changes)


def walked(rng: Generator, route: Route, **changes: Any) -> SimulatedWalk:
    return simulate(route, someone(rng, **changes), int(rng.integers(2**31)))


def usual(rng: Generator) -> SimulatedWalk:
    """A walk on which nothing is wrong yet."""
    return walked(rng, path(corners(rng) if rng.random() < 0.5 else loop(rng)))


def moment(rng: Generator, walk: SimulatedWalk, low: float = 0.25, high: float = 0.75) -> float:
    """A time in the middle of the walk at which the wearer walks straight on."""
    steps, turns = walk.steps.t_s, walk.turns.t_s
    inside = steps[int(low * len(steps)) : int(high * len(steps))]
    off = np.abs(inside[:, None] - turns).min(axis=1, initial=np.inf)
    return float(rng.choice(inside[off >= min(4.0, float(off.max()))]))


def direction(rng: Generator) -> FloatArray:
    vector = rng.standard_normal(3)
    return np.asarray(vector / np.linalg.norm(vector))
