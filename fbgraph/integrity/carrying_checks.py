"""How the device was carried, where that is not as ``device.mount`` says or did not stay the same."""

from __future__ import annotations

import math

import numpy as np

from fbgraph.core.geometry import FloatArray, wrap_scalar
from fbgraph.core.verdict import Reason
from fbgraph.integrity.evidence import Doubt, Evidence

_GROSS_RAD = math.radians(30.0)  # less is how people hold things


def mount_does_not_fit(walk: Evidence) -> list[Doubt]:
    """The legs push another way than ``device.mount`` points."""
    track = walk.track
    angle, sigma = wrap_scalar(float(track.mount_rad[0])), float(track.sigma_turned_rad[0])
    if abs(angle) > _GROSS_RAD:
        text = (
            "device.mount does not fit how the device moved: by the push of the steps one walked "
            f"{_to(angle)} of where it points (± {math.degrees(sigma):.0f}°); the whole walk was turned by as much"
        )
        mount = ", ".join(f"{value:.2f}" for value in forward_b(walk, angle).tolist())
        advice = f"if the device was carried so on purpose, set device.mount = [{mount}]"
        return [Doubt(Reason("carrying", 1.0 + abs(angle), text, advice))]
    held = walk.config.carrying.sigma_held_rad
    if angle == 0.0 and sigma > held and not math.isclose(sigma, walk.config.carrying.sigma_worn_rad):
        text = (
            "device.mount may not fit how the device moved: the push of the steps does not point where it does; "
            f"directions are uncertain by {math.degrees(sigma):.0f}° all along"
        )
        return [Doubt(Reason("carrying", 1.0, text, "check device.mount, or how the device was worn"))]
    return []


def turned_in_hand(walk: Evidence) -> list[Doubt]:
    """The device was turned against the wearer on the way, or may have been."""
    track = walk.track
    doubts = []
    for k in np.flatnonzero(track.sigma_turned_rad[1:] > 0.0).tolist():
        at_s, sigma = float(track.t_s[k]), float(track.sigma_turned_rad[k + 1])
        angle = wrap_scalar(_turned(track.mount_rad, track.sigma_turned_rad, k))
        if angle:
            text = (
                f"the device was turned in the hand at {at_s:.0f} s by {abs(math.degrees(angle)):.0f}° to the "
                f"{'left' if angle > 0 else 'right'} (± {math.degrees(sigma):.0f}°): its heading and the push of the "
                "steps no longer agree as before; directions after it were turned back"
            )
        else:
            text = (
                f"at {at_s:.0f} s the device may have been turned in the hand: its heading and the push of the steps "
                f"may no longer agree as before; directions after it are uncertain by {math.degrees(sigma):.0f}°"
            )
        advice = "hold the device the same way all along, or tell a place after it (anchors)"
        doubts.append(Doubt(Reason("carrying", 1.0 + abs(angle), text, advice, at_s, float(track.t_s[-1]))))
    return doubts


def _turned(mount_rad: FloatArray, sigma_rad: FloatArray, k: int) -> float:
    """By how much the device was turned between breadcrumb ``k`` and when that was over, left positive."""
    later = np.flatnonzero(sigma_rad[k + 2 :] > 0.0)
    until = k + 2 + int(later[0]) if len(later) else len(mount_rad)
    return float(mount_rad[k] - mount_rad[until - 1])


def forward_b(walk: Evidence, angle_rad: float) -> FloatArray:
    """(3,) the body direction ``angle_rad`` to the left of the mount, on level ground, as the device was held."""
    acc, track = walk.log.acc, walk.track
    walked = (acc.t_s >= track.start_s[1]) & (acc.t_s <= track.t_s[-1])
    up = acc.values[walked].mean(axis=0)
    up /= np.linalg.norm(up)
    mount = np.asarray(walk.config.device.mount, dtype=float)
    level = mount - up * (mount @ up)
    level /= np.linalg.norm(level)
    return np.asarray(math.cos(angle_rad) * level + math.sin(angle_rad) * np.cross(up, level))


def _to(angle_rad: float) -> str:
    return f"{abs(math.degrees(angle_rad)):.0f}° to the {'left' if angle_rad > 0 else 'right'}"
