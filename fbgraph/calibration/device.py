"""What walks showed of the device that recorded all of them: its own iron, and its gyroscope's scale."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from fbgraph.core.config import Config, DeviceConfig
from fbgraph.core.geometry import FloatArray
from fbgraph.core.safe_text import short_name
from fbgraph.run.walk_result import WalkResult

_LEAST_READINGS = 40  # of the compass
_ONE_WAY = 0.75  # length of the mean of all headings' unit vectors: who walked more one way than this hardly turned
_LEVEL_ENOUGH = 0.3  # what of device.mount is horizontal; less points nowhere
_SURE_UT = 3.0  # a component that is known no better than this is not told
_FOUND_SIGMAS = 3.0
_ALIKE_SIGMAS = 4.0  # from walk to walk
_PLACE_UT = 1.0  # iron of the places, which is not the same on every walk
_SCALE_TOLD, _SCALE_SIGMAS = 0.6, 2.0  # of the prior's sigma; of its own
_LEAST_IRON_UT, _LEAST_SCALE = 0.5, 0.003  # what is left after a calibration, at least


@dataclass(frozen=True)
class SeenDevice:
    """What one walk showed of its device.

    Attributes:
        name: of the walk.
        axes_b: (2, 3) the device's forward and left, horizontal, in body axes, as it was held.
        iron_ut, iron_sigma_ut: (2,) its own iron along them; nan if the walk does not tell.
        why: why it does not.
        gyro_scale, gyro_scale_sigma: of the gyroscope, by this walk alone; nan if it does not tell.
    """

    name: str
    axes_b: FloatArray
    iron_ut: FloatArray
    iron_sigma_ut: FloatArray
    why: str
    gyro_scale: float
    gyro_scale_sigma: float


@dataclass(frozen=True)
class DeviceFit:
    """A device's own errors, to be taken out; None where the walks do not tell them, ``notes`` say why.

    Attributes:
        iron_ut: (3,) hard iron, body axes.
        iron_sigma_ut: of each component that the walks show.
        gyro_scale, gyro_scale_sigma: share by which the gyroscope shows too much of a turn.
        notes: a sentence on each of the two.
    """

    iron_ut: FloatArray | None
    iron_sigma_ut: float
    gyro_scale: float | None
    gyro_scale_sigma: float
    notes: tuple[str, ...]

    def applied(self, config: Config) -> Config:
        """The configuration with them, beyond what it already took out."""
        device, graph = config.device, config.graph
        if self.iron_ut is not None:
            x, y, z = (round(was + more, 2) for was, more in zip(device.iron_ut, self.iron_ut.tolist(), strict=True))
            device = device.model_copy(update={"iron_ut": (x, y, z)})
            graph = graph.model_copy(update={"sigma_iron_ut": round(max(self.iron_sigma_ut, _LEAST_IRON_UT), 2)})
        if self.gyro_scale is not None:
            total = 1.0 - (1.0 - device.gyro_scale) * (1.0 - self.gyro_scale)
            device = device.model_copy(update={"gyro_scale": round(total, 5)})
            sigma = round(max(self.gyro_scale_sigma, _LEAST_SCALE), 4)
            graph = graph.model_copy(update={"sigma_gyro_scale": min(sigma, graph.sigma_gyro_scale)})
        return config.model_copy(update={"device": device, "graph": graph})


def seen_device(result: WalkResult) -> SeenDevice:
    """What a smoothed walk showed of its device."""
    found, track, name = result.smoothed.device, result.track, short_name(result.log.name)
    axes_b = held_axes(result)
    nothing = np.full(2, np.nan)
    if found is None:
        return SeenDevice(name, axes_b, nothing, nothing, "it could not be smoothed", np.nan, np.nan)
    yaw = (result.smoothed.trajectory.yaw_rad - track.mount_rad)[np.isfinite(track.yaw_mag_rad)]
    one_way = float(np.abs(np.exp(1j * yaw).mean())) if len(yaw) else 1.0
    why = ""
    if len(found.iron_ut) == 0:
        why = "it has no magnetometer"
    elif len(found.iron_ut) > 1:
        why = "the device calibrated its magnetometer anew on the way"
    elif len(yaw) < _LEAST_READINGS:
        why = f"not enough steps: {len(yaw)} with a compass, {_LEAST_READINGS} are needed"
    elif one_way > _ONE_WAY:
        why = "not enough turning: nearly all of it in one direction; walk there and back, or round a block"
    elif not np.isfinite(axes_b).all():
        why = "device.mount points up or down as it was held"
    scale = _by_itself(found.gyro_scale, found.gyro_scale_sigma, result.config.graph.sigma_gyro_scale)
    if why:
        return SeenDevice(name, axes_b, nothing, nothing, why, *scale)
    ahead_left = iron_ahead_left(found.iron_ut[0, :2], result.config.device)
    sigma = np.hypot(np.full(2, float(found.iron_sigma_ut[0, :2].max())), _PLACE_UT)
    return SeenDevice(name, axes_b, ahead_left, sigma, "", *scale)


def _by_itself(value: float, sigma: float, prior: float) -> tuple[float, float]:
    """What a walk told, without what was thought before (a value of 0 within ``prior``); nan if it told nothing."""
    information = 1.0 / sigma**2 - 1.0 / prior**2
    if information <= 1e-6 / prior**2:
        return np.nan, np.nan
    return value / sigma**2 / information, float(information**-0.5)


def iron_ahead_left(iron_ut: FloatArray, device: DeviceConfig) -> FloatArray:
    """(2,) hard iron ahead of the device and to its left, from its state in the graph (``estimators.compass``)."""
    north_rad = np.pi / 2.0 - np.radians(device.declination_deg or 0.0)
    ahead_left = (iron_ut[0] + 1j * iron_ut[1]) * np.exp(1j * north_rad)
    return np.array([ahead_left.real, ahead_left.imag])


def held_axes(result: WalkResult) -> FloatArray:
    """(2, 3) forward and left of a device in its own axes, as it was held while walking; nan if mount points up."""
    acc, track = result.log.acc, result.track
    walked = (acc.t_s >= track.start_s[0]) & (acc.t_s <= track.t_s[-1])
    up_b = acc.values[walked].mean(axis=0)
    up_b = up_b / np.linalg.norm(up_b)
    mount_b = np.asarray(result.config.device.mount) / np.linalg.norm(result.config.device.mount)
    forward_b = mount_b - (mount_b @ up_b) * up_b
    if (level := float(np.linalg.norm(forward_b))) < _LEVEL_ENOUGH:
        return np.full((2, 3), np.nan)
    return np.stack((forward_b / level, np.cross(up_b, forward_b / level)))


def fit_device(walks: Sequence[SeenDevice], sigma_gyro_scale: float) -> DeviceFit:
    """What walks with one device have in common.

    Args:
        walks: what each showed.
        sigma_gyro_scale: prior on the gyroscope's scale with which they were smoothed.
    """
    iron_ut, iron_sigma_ut, iron_note = _common_iron([walk for walk in walks if not walk.why], walks)
    scale, scale_sigma, scale_note = _common_scale(walks, sigma_gyro_scale)
    return DeviceFit(iron_ut, iron_sigma_ut, scale, scale_sigma, (iron_note, scale_note))


def _common_iron(telling: Sequence[SeenDevice], walks: Sequence[SeenDevice]) -> tuple[FloatArray | None, float, str]:
    """Hard iron in body axes, its standard deviation, and what to say; along an axis that nothing shows it is 0."""
    if not telling:
        return None, np.nan, f"hard iron: not told; {walks[0].name}: {walks[0].why}"
    rows = np.concatenate([walk.axes_b / walk.iron_sigma_ut[:, None] for walk in telling])
    seen = np.concatenate([walk.iron_ut / walk.iron_sigma_ut for walk in telling])
    # in the axes of the information: a device that is always held alike shows nothing along the vertical
    information, axes = np.linalg.eigh(rows.T @ rows)
    shown = information > 1.0 / _SURE_UT**2
    along = np.where(shown, axes.T @ rows.T @ seen / np.maximum(information, 1e-12), 0.0)
    iron_ut = axes @ along
    if shown.sum() < 2:
        sigma_ut = float(1.0 / np.sqrt(max(information[1], 1e-12)))
        return None, np.nan, f"hard iron: not told, ± {2.0 * sigma_ut:.0f} µT (2σ) only: turn more, walk longer"
    if (worst := float(np.abs(rows @ iron_ut - seen).max())) > _ALIKE_SIGMAS:
        text = f"it differs from walk to walk, by up to {worst:.0f} standard deviations: the device calibrates itself"
        return None, np.nan, f"hard iron: not told, {text}, or carried iron on some walks only"
    sigma_ut = float(1.0 / np.sqrt(information[shown].min()))
    size_ut = float(np.linalg.norm(iron_ut))
    said = f"{size_ut:.1f} µT (± {2.0 * sigma_ut:.1f}, 2σ) by {len(telling)} of {len(walks)} walks"
    if size_ut < _FOUND_SIGMAS * sigma_ut:
        return None, sigma_ut, f"hard iron: none to speak of, {said}"
    return iron_ut, sigma_ut, f"hard iron: {said}{'' if shown.all() else ', level; its vertical part nothing shows'}"


def _common_scale(walks: Sequence[SeenDevice], prior: float) -> tuple[float | None, float, str]:
    """The gyroscope's scale, its standard deviation, and what to say; the prior counts once, however many walks."""
    known = [(walk.gyro_scale, walk.gyro_scale_sigma) for walk in walks if np.isfinite(walk.gyro_scale_sigma)]
    information = 1.0 / prior**2 + sum(1.0 / one**2 for _, one in known)
    sigma = float(information**-0.5)
    if sigma > _SCALE_TOLD * prior:
        text = "not enough turning that the compass can check: walk a figure of eight between known places"
        return None, sigma, f"gyroscope's scale: not told, {text}"
    scale = float(sum(value / one**2 for value, one in known)) / information
    said = f"{100.0 * scale:+.2f} % (± {200.0 * sigma:.2f}, 2σ) of every turn"
    if abs(scale) < _SCALE_SIGMAS * sigma:
        return None, sigma, f"gyroscope's scale: nothing to speak of, {said}"
    return scale, sigma, f"gyroscope's scale: {said}"
