"""The way back matched to the way out."""

import numpy as np
from scipy.ndimage import gaussian_filter1d

from fbgraph.core.config import load_config
from fbgraph.way_back.closures import ClosureMaker
from fbgraph.way_back.matcher import RouteMatcher
from fbgraph.way_back.way_out import Outbound


def test_a_route_of_kilometres_is_matched_as_finely_as_a_short_one() -> None:
    """Three kilometres out and back, without errors: on the route all the way, to the start, and closures on it."""
    length_m, count = 0.7, 4300
    yaw = 0.6 * np.sin(np.arange(count) / 40.0)
    way_m = np.cumsum(length_m * np.exp(1j * yaw))
    at_m = np.array(length_m * np.arange(count), dtype=np.float64)
    field = gaussian_filter1d(np.random.default_rng(1).normal(size=(count, 2)), 4.0, axis=0)
    field *= 6.0 / field.std()
    outbound = Outbound(
        t_s=np.array(0.6 * np.arange(count), dtype=np.float64),
        x_m=way_m.real,
        y_m=way_m.imag,
        route_m=at_m,
        level_m=at_m,
        mag_up_ut=field[:, 0],
        mag_level_ut=field[:, 1],
        altitude_m=np.zeros(count),
    )
    config = load_config("m5stickc").returning
    matcher, maker, closures, off = RouteMatcher(outbound, config), ClosureMaker(outbound, config), 0, 0
    for k in range(count - 1, 0, -1):
        match = matcher.advance(length_m, length_m, float(yaw[k] + np.pi), (field[k, 0], field[k, 1]), 0.0)
        closure = maker.advance(2 * count - k, length_m, match)
        closures += closure is not None
        off += match.off_route
        assert abs(match.route_m - at_m[k - 1]) < 3.0
    assert off == 0
    assert closures > 500
