"""When somebody turns back, and when nobody does."""

import numpy as np
import pytest
from support.walking import guided, route

from fbgraph.simulator.routes import Route, load_route
from fbgraph.simulator.simulate import simulate
from fbgraph.way_back.records import Crumb, TurnBack
from fbgraph.way_back.turn_back import TurnBackDetector


@pytest.mark.parametrize("name", ["straight", "square", "eight"])
def test_no_turn_back_where_nobody_turns_back(name: str) -> None:
    assert guided(simulate(load_route(name, 2.0), seed=1).log, "auto", 5.0).turn_back is None


def crumbs(route_: Route) -> list[Crumb]:
    """A step every 0.6 m along a route."""
    at = np.append(0.0, np.cumsum(np.hypot(*np.diff(route_.waypoints_m[:, :2], axis=0).T)))
    walked = np.arange(0.0, at[-1], 0.6)
    x, y = (np.interp(walked, at, axis) for axis in route_.waypoints_m[:, :2].T)
    yaw = np.arctan2(np.gradient(y), np.gradient(x))
    return [Crumb(s / 1.2, *row, 0.0, a, s) for s, row, a in zip(walked, zip(x, y, strict=True), yaw, strict=True)]


def first_turn_back(route_: Route) -> TurnBack | None:
    detector = TurnBackDetector(12.0)
    return next((found for crumb in crumbs(route_) if (found := detector.advance(crumb))), None)


def test_a_dead_end_is_no_turn_back() -> None:
    assert first_turn_back(route((0, 0), (20, 0), (20, 8), (20, 0), (45, 0))) is None
    found = first_turn_back(route((0, 0), (20, 0), (20, 15), (20, 0), (45, 0)))
    assert found is not None
    assert abs(found.t_s - 35 / 1.2) < 1.5
    assert first_turn_back(route((0, 0), (30, 0), (30, 4), (0, 4))) is None  # a parallel aisle
