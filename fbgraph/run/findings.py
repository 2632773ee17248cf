"""What happened on a walk, and when: stretches to show as lanes over time, and sentences for people."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from fbgraph.core.checkpoints import Checkpoints, anchor_breadcrumbs
from fbgraph.core.geometry import FloatArray, turned, wrap_angle
from fbgraph.run.altitude_findings import altitude_findings
from fbgraph.run.calibration_findings import calibration_findings
from fbgraph.run.device_findings import device_findings
from fbgraph.run.finding import Finding
from fbgraph.run.metrics import RigidFit, fit_to_truth, leg_errors
from fbgraph.run.timeline_lanes import DOUBTED_BELOW, MOVING, compass_trust, stretches, wearer_lane
from fbgraph.run.walk_result import WalkResult

_PAUSE_S = 3.0  # walking without a step for longer is told
_SLOW, _FAST = 0.7, 1.4  # of the usual step frequency
_SAME_HEIGHT_M = 0.5  # passes of one place that differ by more in altitude are told
_FIXES_NAMED = 4  # GNSS anchors that are told one by one
_TURNED_RAD, _FITS = float(np.radians(20.0)), 0.1  # truth turned further, and then fitting to a tenth of its spread
_MOST = 5  # stretches of one kind that are told


def walk_findings(result: WalkResult) -> list[Finding]:
    """Everything worth telling of a walk, in order of time; of each kind the longest stretches only."""
    device = device_findings(result.smoothed.device, result.track)
    air = altitude_findings(result)
    placed = _places(result), _axis(result), _truth(result)
    kinds = (_compass(result), _steps(result), _gaps(result), air, *placed, device)
    chosen = [f for kind in kinds for f in sorted(kind, key=lambda f: f.start_s - f.end_s)[:_MOST]]
    chosen += calibration_findings(result.track, result.config.step_length)
    return sorted([*_doubts(result), *chosen, *_worn(result), *_bias(result)], key=lambda finding: finding.start_s)


def _doubts(result: WalkResult) -> list[Finding]:
    """Why the walk is doubted, as its verdict says: all of it, however much."""
    return [
        Finding(
            reason.kind,
            0.0 if reason.start_s is None else reason.start_s,
            result.log.duration_s if reason.end_s is None else reason.end_s,
            reason.sentence,
        )
        for reason in result.integrity.reasons
    ]


def _compass(result: WalkResult) -> list[Finding]:
    track, smoothed = result.track, result.smoothed.trajectory
    off = np.degrees(wrap_angle(track.yaw_mag_rad - smoothed.yaw_rad))
    distance_m = smoothed.distance_m
    found = []
    for first, last in stretches(compass_trust(result) < DOUBTED_BELOW):
        span = slice(first, last + 1)
        worst = float(off[span][np.nanargmax(np.abs(off[span]))])
        by = f"up to {abs(worst):.0f}° off to the {'left' if worst > 0 else 'right'} of the smoothed heading"
        if abs(worst) > 90.0:
            by = "useless, more than 90° off the smoothed heading"
        norm = track.mag_norm_ut[span]
        found.append(
            Finding(
                "compass",
                float(track.start_s[first]),
                float(track.t_s[last]),
                f"compass doubted for {distance_m[last] - distance_m[max(first - 1, 0)]:.0f} m "
                f"(steps {first} to {last}): "
                f"{by}, field {np.nanmin(norm):.0f} to {np.nanmax(norm):.0f} µT",
            )
        )
    return found


def _steps(result: WalkResult) -> list[Finding]:
    """Walking without steps, and steps much slower or faster than usual: found too few, or too many."""
    track = result.track
    usual_hz = float(np.median(track.frequency_hz[1:]))
    found = []
    for name, which in (
        ("slower", track.frequency_hz < _SLOW * usual_hz),
        ("faster", track.frequency_hz > _FAST * usual_hz),
    ):
        which[0] = False  # the standing start
        cause = "some may have been missed" if name == "slower" else "some may be false"
        for first, last in stretches(which):
            rate = np.median(track.frequency_hz[first : last + 1])
            text = f"steps {first} to {last} much {name} than usual ({rate:.1f} against {usual_hz:.1f} Hz): {cause}"
            found.append(Finding("steps", float(track.start_s[first]), float(track.t_s[last]), text))
    lane = wearer_lane(result.signals, track, result.config.attitude.still_window_s)
    ends = [*(t for t, _ in lane[1:]), result.track.t_s[-1]]
    for (start_s, state), end_s in zip(lane, ends, strict=True):
        inside = track.t_s[0] < start_s and end_s <= track.t_s[-1]
        if state == MOVING and inside and end_s - start_s > _PAUSE_S:
            text = (
                f"neither still nor stepping for {end_s - start_s:.0f} s: handling, turning on the spot, missed steps"
            )
            found.append(Finding("steps", start_s, float(end_s), text))
    return found


def _gaps(result: WalkResult) -> list[Finding]:
    track = result.track
    return [
        Finding(
            "gap", float(track.t_s[k - 1]), float(track.t_s[k]), "gap in the log: direction across it is the compass's"
        )
        for k in np.flatnonzero(track.chained == 0)
    ]


def _places(result: WalkResult) -> list[Finding]:
    """What anchors, closures and a closed end did to the walk, and which of them were doubted."""
    smoothed, ekf, track = result.smoothed.trajectory, result.trajectories["ekf"], result.track
    frame = result.smoothed.aids.frame
    free = turned(ekf.xy_m - ekf.xy_m[0], 0.0 if frame is None else -frame.turn_rad) + smoothed.xy_m[0]
    weights = {
        kind.name: dict(zip(kind.k.tolist(), kind.weight.tolist(), strict=True)) for kind in result.smoothed.residuals
    }
    told: list[tuple[str, int, FloatArray]] = []
    found: list[Finding] = []
    if (anchors := result.aids.anchors) is not None and anchors.gnss and len(anchors) > _FIXES_NAMED:
        found.append(_fixes(result, anchors, weights.get("anchor", {})))
    elif anchors is not None:
        crumbs = anchor_breadcrumbs(anchors, track.t_s).tolist()
        told += [("anchor", k, place) for k, place in zip(crumbs, anchors.xy_m, strict=True)]
    if result.told.closed_walk and not any(reason.kind == "closed_walk" for reason in result.smoothed.doubts):
        told.append(("closed walk", len(smoothed) - 1, smoothed.xy_m[0]))
    if closures := result.smoothed.closures:
        doubted = result.smoothed.closures_doubted
        both = [np.median([np.hypot(*(path[c.i] - path[c.j])) for c in closures]) for path in (smoothed.xy_m, free)]
        text = (
            f"the way back was tied to the way out at {len(closures)} places ({doubted} doubted): both passes are "
            f"{both[0]:.1f} m apart as smoothed (median), {both[1]:.1f} m by the EKF, which was not told"
        )
        found.append(Finding("closure", float(track.t_s[closures[0].j]), float(track.t_s[closures[-1].j]), text))
        higher_m = float(np.median([smoothed.z_m[c.j] - smoothed.z_m[c.i] for c in closures]))
        if abs(higher_m) > _SAME_HEIGHT_M:
            text = f"by the barometer the way back lies {higher_m:+.1f} m above the way out: its pressure drifted"
            found.append(Finding("altitude", float(track.t_s[closures[0].j]), float(track.t_s[closures[-1].j]), text))
    for name, k, place in told:
        at_s = float(track.t_s[k])
        near, before = np.hypot(*(smoothed.xy_m[k] - place)), np.hypot(*(free[k] - place))
        text = f"{name} at step {k}: the smoothed walk is {near:.1f} m from it, the EKF, not told of it, {before:.1f} m"
        if weights.get(name, {}).get(k, 1.0) < DOUBTED_BELOW:
            text += "; doubted, the walk was pulled less than half as far as it asked"
        found.append(Finding(name.replace(" ", "_"), at_s, at_s, text))
    return found


def _axis(result: WalkResult) -> list[Finding]:
    """How the walk lies to the axis of its building, if it was turned to it."""
    fit, t_s = result.smoothed.axis, result.track.t_s
    if fit is None or not fit.used:
        return []
    side = "left" if fit.turned_rad > 0 else "right"
    text = (
        f"by the building's axis the walk is turned by {abs(np.degrees(fit.turned_rad)):.1f} ± "
        f"{np.degrees(2.0 * fit.sigma_rad):.1f}° (2σ) to the {side} of where the compass puts it: "
        f"{fit.along} of its {fit.legs} straight legs run along corridors"
    )
    return [Finding("axis", float(t_s[0]), float(t_s[-1]), text)]


def _fixes(result: WalkResult, fixes: Checkpoints, weights: Mapping[int, float]) -> Finding:
    """One sentence on many fixes of a receiver."""
    smoothed, crumbs = result.smoothed.trajectory, anchor_breadcrumbs(fixes, result.track.t_s)
    off_m = np.hypot(*(smoothed.xy_m[crumbs] - fixes.xy_m).T)
    doubted = sum(weights.get(k, 1.0) < DOUBTED_BELOW for k in crumbs.tolist())
    text = (
        f"{len(fixes)} GNSS fixes: the smoothed walk is {float(np.median(off_m)):.1f} m from them (median, at most "
        f"{float(off_m.max()):.1f} m), {doubted} of them doubted"
    )
    return Finding("anchor", float(fixes.t_s[0]), float(fixes.t_s[-1]), text)


def _truth(result: WalkResult) -> list[Finding]:
    """Where truth is known: whether the smoothed walk is as sure as it may be, and what its error is made of."""
    truth, smoothed = result.told.truth, result.smoothed.trajectory
    sigma_m = smoothed.longest_sigma_m
    if truth is None or len(truth) < 2 or sigma_m is None:
        return []
    t_s = truth.t_s - result.log.t0_s
    off_m = np.hypot(*(smoothed.at(t_s)[:, :2] - truth.xy_m - result.truth_shift_m).T)[1:]
    own_m = np.nan_to_num(truth.sigma_m, nan=0.0)
    survey_m = np.hypot(own_m[1:], own_m[0] if result.told.anchors is None else 0.0)  # the first is where both agree
    limit_m = 2.0 * np.hypot(np.interp(t_s[1:], smoothed.t_s, sigma_m), survey_m)
    beyond = off_m > np.maximum(limit_m, 0.5)  # checkpoints of unknown sigma are not surveyed better
    start_s, end_s = float(t_s[0]), float(t_s[-1])
    found = []
    if beyond.mean() > 0.1:
        text = f"the smoothed walk is further from the truth than its 2σ at {beyond.sum()} of {len(off_m)} checkpoints"
        found.append(Finding("truth", start_s, end_s, text))
    legs = leg_errors(smoothed, truth, result.log.t0_s)
    if len(legs.yaw_rad) == 0:
        return found
    yaw_deg, length = float(np.degrees(np.median(legs.yaw_rad))), float(np.median(legs.length_rel))
    fit = fit_to_truth(smoothed, truth, result.log.t0_s, result.log.span_s)
    if (text := _other_frame(fit, float(np.sqrt((off_m**2).mean())))) and len(truth) > 2:
        found.append(Finding("truth", start_s, end_s, text))
    elif abs(yaw_deg) > 8.0:
        text = (
            f"by the truth the smoothed walk is turned {abs(yaw_deg):.0f}° to the {'left' if yaw_deg > 0 else 'right'} "
            "(median leg): how the device was held, declination, or iron all along; nothing in the sensors tells"
        )
        found.append(Finding("truth", start_s, end_s, text))
    if abs(length) > 0.08:
        by = f"{100.0 * abs(length):.0f} % too {'long' if length > 0 else 'short'}"
        text = f"by the truth the smoothed walk is {by} (median leg)"
        found.append(Finding("truth", start_s, end_s, text))
    return found


def _other_frame(fit: RigidFit, rmse_m: float) -> str:
    """That the walk is as the truth says but for a turn, if it is; ``rmse_m`` is its error as it lies."""
    if fit.turn_rad is None or abs(fit.turn_rad) <= _TURNED_RAD or fit.rmse_m > _FITS * fit.spread_m:
        return ""
    side = "left" if fit.turn_rad > 0 else "right"
    return (
        f"the smoothed walk is turned {abs(np.degrees(fit.turn_rad)):.0f}° to the {side} of the truth and fits it once "
        f"turned back (RMSE {rmse_m:.1f} m as it is, {fit.rmse_m:.1f} m aligned): truth in another frame (a building's "
        "axes, grid North), how the device was held, or iron all along; nothing in the sensors tells"
    )


def _worn(result: WalkResult) -> list[Finding]:
    """A device that is not held before the wearer: where its directions come from."""
    track = result.track
    turned_deg, sigma_deg = (float(np.degrees(column[0])) for column in (track.mount_rad, track.sigma_turned_rad))
    if sigma_deg == 0.0 or any(
        reason.kind == "carrying" and reason.start_s is None for reason in result.integrity.reasons
    ):
        return []
    text = (
        "the device was worn upright or on a limb, so device.mount says little of where one walked: "
        f"by the push of the steps {abs(turned_deg):.0f}° to the {'left' if turned_deg > 0 else 'right'} of it, "
        f"uncertain by {sigma_deg:.0f}°"
    )
    return [Finding("carrying", float(track.t_s[0]), float(track.t_s[-1]), text)]


def _bias(result: WalkResult) -> list[Finding]:
    """One sentence on the gyroscope's bias, at the end of the walk."""
    smoothed = result.smoothed.trajectory
    bias = np.degrees(smoothed.gyro_bias_rad_s)
    sigma = smoothed.sigma_bias_rad_s
    give = f" ± {2.0 * np.degrees(sigma[-1]):.2f}" if sigma is not None else ""
    text = f"gyroscope's bias by the smoother {bias[-1]:+.2f}{give} °/s (2σ) at the end; " + (
        f"it moved between {bias.min():+.2f} and {bias.max():+.2f} °/s"
        if np.ptp(bias) >= 0.01
        else "the same all along"
    )
    return [Finding("gyro_bias", float(smoothed.t_s[-1]), float(smoothed.t_s[-1]), text)]
