"""What a walk showed of the device that recorded it: its own iron, recalibrations, the gyroscope's scale."""

from __future__ import annotations

import numpy as np

from fbgraph.estimators.estimates import DeviceErrors
from fbgraph.front_end.step_track import StepTrack
from fbgraph.run.finding import Finding

_IRON_UT, _IRON_SIGMAS = 5.0, 3.0  # less is what a calibrated device has
_SCALE, _SCALE_SIGMAS = 0.02, 2.5


def device_findings(device: DeviceErrors | None, track: StepTrack) -> list[Finding]:
    """Sentences on the device's errors, where they matter.

    Args:
        device: what the smoother found out about it.
        track: the steps.
    """
    jumped = np.hypot(track.jump_x_ut, track.jump_y_ut)
    found = [_jump(track, k, float(jumped[k]), device) for k in np.flatnonzero(jumped).tolist()]
    if device is None:
        return found
    begin_s, end_s = float(track.start_s[0]), float(track.t_s[-1])
    ends = [*device.stretch_starts[1:].tolist(), len(track)]
    for j, iron_ut in enumerate(device.iron_ut):
        iron, sigma = float(np.hypot(*iron_ut[:2])), float(np.hypot(*device.iron_sigma_ut[j, :2]))
        if iron > max(_IRON_UT, _IRON_SIGMAS * sigma):
            turned_deg = float(np.degrees(np.arcsin(min(iron / max(float(iron_ut[2]), 1e-6), 1.0))))
            text = (
                f"the device's own iron adds {iron:.0f} µT (± {2.0 * sigma:.0f}, 2σ) to a horizontal field of "
                f"{iron_ut[2]:.0f} µT, which turns its compass by up to {turned_deg:.0f}°: the smoother takes it out; "
                "calibrate the magnetometer"
            )
            span = (float(track.start_s[device.stretch_starts[j]]), float(track.t_s[ends[j] - 1]))
            found.append(Finding("iron", *span, text))
    if abs(device.gyro_scale) > max(_SCALE, _SCALE_SIGMAS * device.gyro_scale_sigma):
        by = f"{100.0 * abs(device.gyro_scale):.1f} % too {'much' if device.gyro_scale > 0 else 'little'}"
        text = f"the gyroscope shows {by} of every turn (± {200.0 * device.gyro_scale_sigma:.1f}, 2σ), taken out"
        found.append(Finding("gyro_scale", begin_s, end_s, text))
    return found


def _jump(track: StepTrack, k: int, jump_ut: float, device: DeviceErrors | None) -> Finding:
    """The magnetometer's zero jumped."""
    text = f"the magnetometer's zero jumped by {jump_ut:.0f} µT, recalibrated, or a magnet came to stay: "
    if device is not None and k in device.stretch_starts:
        text += "taken out"
    else:
        text += "not taken out, the walk is explained better without: directions before and after may differ"
    return Finding("recalibration", float(track.start_s[k]), float(track.t_s[k]), text)
