"""Walks made by hand whose device has iron of its own, and whose gyroscope shows too much of every turn."""

import math
from collections.abc import Sequence
from typing import Any

import numpy as np

from fbgraph.core.geometry import FloatArray
from fbgraph.front_end.step_track import StepTrack
from support.by_hand import hand_step

LEVEL_UT, DOWN_UT = 20.0, 43.0
"""The Earth's field: horizontal strength, and what points down."""


def seen(yaw_rad: FloatArray, iron_ut: FloatArray) -> dict[str, FloatArray]:
    """What a magnetometer shows of the field with this iron, (N, 2) or (2,) ahead and to the left of the device.

    The field lies along yaw 0, so that its direction in the device is against the yaw.
    """
    u = LEVEL_UT * np.cos(yaw_rad) + np.broadcast_to(iron_ut, (len(yaw_rad), 2))[:, 0]
    v = -LEVEL_UT * np.sin(yaw_rad) + np.broadcast_to(iron_ut, (len(yaw_rad), 2))[:, 1]
    level = np.hypot(u, v)
    return {
        "yaw_mag_rad": np.arctan2(-v, u),
        "mag_norm_ut": np.hypot(level, DOWN_UT),
        "mag_dip_rad": np.arctan2(DOWN_UT, level),
    }


def laps(count: int = 2, side: int = 15, way: float = 1.0, first_rad: float = 0.3) -> FloatArray:
    """(4 · count · side,) directions of the steps of so many rounds about a square, to the left where ``way`` is 1."""
    return first_rad + way * np.repeat(np.arange(4 * count) * math.pi / 2, side)


def magnetised(
    yaw_rad: FloatArray,
    iron_ut: Sequence[float] | FloatArray = (0.0, 0.0),
    bias_rad_s: float = 0.0,
    scale: float = 0.0,
    compass: bool = True,
    noise_rad: float = 0.0,
    jump: tuple[int, float, float] | None = None,
    **given: Any,
) -> StepTrack:
    """A walk of steps of 0.7 m, half a second each, in these directions.

    Args:
        yaw_rad: (K,) of the steps.
        iron_ut: of the device.
        bias_rad_s, scale: of its gyroscope, which shows g of a turn of (1 - scale) g.
        compass: whether there is a magnetometer.
        noise_rad: of both of them, at each step.
        jump: at which step the front end says that the zero jumped, and by how much.
        given: of every step.
    """
    rng = np.random.default_rng(5)
    turned = np.diff(yaw_rad, prepend=yaw_rad[0]) + 0.5 * bias_rad_s
    gyro = 1.0 + np.cumsum(turned / (1.0 - scale) + noise_rad * rng.normal(size=len(yaw_rad)))
    field = seen(yaw_rad + noise_rad * rng.normal(size=len(yaw_rad)), np.array(iron_ut))
    steps = [hand_step(t_s=0.0, yaw_s=-0.25, length_m=0.0, yaw_gyro_rad=1.0)]
    for i in range(len(yaw_rad)):
        at = {"t_s": 0.5 * (i + 1), "start_s": 0.5 * i, "yaw_s": 0.25 + 0.5 * i, "length_m": 0.7}
        heard = {name: float(column[i]) for name, column in field.items()} if compass else {}
        jumped = {"jump_x_ut": jump[1], "jump_y_ut": jump[2]} if jump is not None and jump[0] == i + 1 else {}
        steps.append(hand_step(**(given | at | heard | jumped | {"yaw_gyro_rad": float(gyro[i])})))
    return StepTrack(steps)
