"""Errors of legs."""

from __future__ import annotations

import numpy as np

from fbgraph.core.checkpoints import checkpoints
from fbgraph.core.trajectory import Trajectory
from fbgraph.run.metrics import leg_errors


def test_leg_errors_are_those_of_scale_and_turn() -> None:
    t_s = np.arange(9.0)
    x_m, y_m = np.array([0, 5, 10, 10, 10, 5, 0, 0, 0.0]), np.array([0, 0, 0, 5, 10, 10, 10, 5, 0.0])
    truth = checkpoints(t_s[::2] + 7.0, x_m[::2], y_m[::2])
    turned = 1.1 * (x_m + 1j * y_m) * np.exp(1j * np.radians(12.0)) + (3.0 - 4.0j)
    zeros = np.zeros(9)
    legs = leg_errors(Trajectory(t_s, turned.real, turned.imag, zeros, zeros, zeros), truth, 7.0)
    np.testing.assert_allclose(legs.length_rel, 0.1)
    np.testing.assert_allclose(np.degrees(legs.yaw_rad), 12.0)
    np.testing.assert_allclose(legs.end_s - legs.start_s, 2.0)
