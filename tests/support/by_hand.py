"""Steps and ways made by hand, with answers that can be told on paper."""

import itertools
import math
from collections.abc import Sequence
from typing import Any

import numpy as np
import numpy.typing as npt

from fbgraph.core.config import StepLengthConfig
from fbgraph.core.trajectory import Breadcrumb, Trajectory
from fbgraph.front_end.step_track import Step
from fbgraph.way_back.records import Match

HALF_A_METRE = StepLengthConfig(alpha_m=0.5, beta_m_s=0.0, gamma_m=0.0, beta2_m_s2=0.0, kappa_surge=0.0)
"""Every step is half a metre long on the level."""


def hand_step(**given: Any) -> Step:
    """A step of half a metre that says nothing of field and altitude."""
    silent = dict.fromkeys(("yaw_mag_rad", "mag_norm_ut", "mag_dip_rad", "altitude_m", "altitude_sigma_m"), math.nan)
    rest = {"rest_rate_rad_s": math.nan, "rest_sigma_rad_s": math.nan, "rest_s": 0.0}
    usual = {"t_s": 0.5, "start_s": 0.0, "length_m": 0.5, "frequency_hz": 2.0, "slope": 0.0, "shortened_m": 0.0}
    usual |= {"jump_x_ut": 0.0, "jump_y_ut": 0.0, "rest_drift_sigma_rad": 0.0}
    usual |= {"rest_drift_rad": given.get("rest_rate_rad_s", 0.0) * given["rest_s"] if given.get("rest_s") else 0.0}
    usual |= {"gusty": False, "carried_m": 0.0, "blown_m": 0.0}
    usual |= {"bounce_m_s2": 5.0, "surge_m_s": 0.2, "doubt_m": 0.0, "yaw_s": 0.25, "yaw_gyro_rad": 0.0, "chained": True}
    return Step(**(silent | rest | usual | given))


def way_along(*corners: tuple[float, float], step_m: float = 0.5, dt_s: float = 0.5, t0_s: float = 0.0) -> Trajectory:
    """A breadcrumb every step along straight lines between corners, a whole number of steps each."""
    places, yaws = [complex(*corners[0])], []
    for start, end in itertools.pairwise(corners):
        leg = complex(end[0] - start[0], end[1] - start[1])
        count = round(abs(leg) / step_m)
        assert abs(count * step_m - abs(leg)) < 1e-9
        places += [complex(*start) + leg * (i + 1) / count for i in range(count)]
        yaws += [math.atan2(leg.imag, leg.real)] * count
    zeros = np.zeros(len(places))
    xy = np.array(places)
    yaw_rad = np.array([yaws[0], *yaws])
    return Trajectory(t0_s + dt_s * np.arange(float(len(xy))), xy.real, xy.imag, zeros, yaw_rad, zeros)


def steps_of(way: Trajectory, **given: Sequence[Any] | npt.NDArray[Any]) -> list[Step]:
    """The steps that make such a way, the standing start first; columns may be given."""
    lengths = np.diff(way.distance_m, prepend=0.0)
    return [
        hand_step(
            **{
                "t_s": float(way.t_s[k]),
                "start_s": float(way.t_s[max(k - 1, 0)]),
                "length_m": float(lengths[k]),
                **{
                    name: column[k].item() if isinstance(column, np.ndarray) else column[k]
                    for name, column in given.items()
                },
            }
        )
        for k in range(len(way))
    ]


def crumb_of(way: Trajectory, k: int) -> Breadcrumb:
    """One breadcrumb of it."""
    columns = (way.t_s, way.x_m, way.y_m, way.z_m, way.yaw_rad, way.gyro_bias_rad_s, way.distance_m)
    return Breadcrumb(k, *(float(column[k]) for column in columns))


def match_at(route_m: float = 30.0, **given: Any) -> Match:
    """On the route, walking back."""
    usual = {"sigma_m": 0.3, "breadcrumb": 60, "cross_m": 0.0, "off_route": False, "facing_back": True}
    return Match(**({"route_m": route_m, "bearing_rad": 0.0, "steady_m": 10.0} | usual | given))
