"""Walks of one wearer with one device, between known places or of known length, to what ``--config`` takes."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

import tomli_w

from fbgraph.calibration.device import DeviceFit, SeenDevice, fit_device, seen_device
from fbgraph.calibration.gyroscope import scale_by_places
from fbgraph.calibration.legs import Legs, leg_of_distance, legs_between
from fbgraph.calibration.wearer import WearerFit, fit_wearer
from fbgraph.core.aids import Told
from fbgraph.core.checkpoints import Checkpoints
from fbgraph.core.config import Config
from fbgraph.core.earth_field import with_declination
from fbgraph.core.errors import DataError
from fbgraph.core.safe_text import for_terminal, short_name
from fbgraph.core.sensor_log import SensorLog
from fbgraph.core.whole_writes import whole_file
from fbgraph.pipeline import reconstruct
from fbgraph.run.walk_result import WalkResult
from fbgraph.workers.run_tasks import run_tasks

_TOLD_AT_MOST = 5


@dataclass(frozen=True)
class KnownWalk:
    """A walk of which a length is known.

    Attributes:
        log: what the sensors said.
        told: places in it, anchors before truth, and where on Earth it was.
        distance_m: how far it went, from the first step to the last; places are not asked then.
    """

    log: SensorLog
    told: Told
    distance_m: float | None = None

    @property
    def places(self) -> Checkpoints | None:
        """Known ones, on the log's event clock."""
        return self.told.anchors if self.told.anchors is not None else self.told.truth

    def require_length(self) -> None:
        """Refuse a walk of which no length is known.

        Raises:
            DataError: it is so, or its places are another's.
        """
        if self.distance_m is not None:
            return
        places, name, log = self.places, short_name(self.log.name), self.log
        if places is None or len(places) < 2:
            found = "it carries no known places" if places is None else f"{places.source}: one known place"
            raise DataError(
                f"{name}: {found}, so no length is known; say --distance METRES, or name --truth or --anchors"
            )
        if places.doubt:
            raise DataError(f"{places.source}: {places.doubt}")
        places.require_within(log.t0_s + log.acc.t_s[0], log.t0_s + log.acc.t_s[-1])


@dataclass(frozen=True)
class Calibration:
    """A wearer and a device, calibrated.

    Attributes:
        config: what it was asked with, and what was found in it.
        wearer: step length.
        device: hard iron and gyroscope.
        notes: what to know before believing it.
    """

    config: Config
    wearer: WearerFit
    device: DeviceFit
    notes: tuple[str, ...]

    def as_dict(self) -> dict[str, Any]:
        """For JSON."""
        device = asdict(self.device)
        iron_ut = self.device.iron_ut
        known = {key: None if value != value else value for key, value in device.items() if key != "iron_ut"}
        device = known | {"iron_ut": None if iron_ut is None else iron_ut.tolist()}
        return {
            "wearer": {**asdict(self.wearer), "used": self.wearer.better},
            "device": device,
            "notes": list(self.notes),
        }

    def to_toml(self) -> str:
        """What ``--config`` takes: all keys that differ from the defaults, below lines on what they come from."""
        wearer, checked = self.wearer, self.wearer.cross_validation
        said = [
            "A wearer and a device by `fbgraph calibrate`; --config takes it.",
            f"Step length {'fitted to' if wearer.better else 'as it was, for it does no better fitted to'} "
            f"{wearer.walks} walks, {wearer.legs} legs, {wearer.walked_m:.0f} m, {wearer.steps} steps: "
            f"{wearer.scale:.3f} of what it was (± {1.96 * wearer.scale_sigma:.3f}, 95 %).",
        ]
        if checked is not None:
            said.append(
                f"A {checked.left_out} left out at a time, {checked.count} of them: {checked.shipped_rel:.1%} off as "
                f"it was, {checked.fitted_rel:.1%} as fitted to the others."
            )
        said += [f"{note[0].upper()}{note[1:]}." for note in self.device.notes]
        comments = "".join(f"# {for_terminal(line)}\n" for line in said)
        return f"{comments}\n{tomli_w.dumps(self.config.model_dump(mode='json', exclude_defaults=True))}"

    def save(self, path: str | Path) -> Path:
        """Write that file, whole or not at all; returns where.

        Raises:
            ConfigError: it cannot be written.
        """
        out = Path(path)
        with whole_file(out) as partial:
            partial.write_text(self.to_toml(), "utf-8")
        return out


def calibrate_walks(
    walks: Sequence[KnownWalk],
    config: Config,
    progress: Callable[[str], None] = lambda name: None,
    workers: int | None = 0,
) -> Calibration:
    """Calibrate the step length of a wearer, and a device's iron and gyroscope.

    Args:
        walks: of one wearer with one device.
        config: where fitting starts: its step length's terms are those that are fitted.
        progress: told the name of each walk that is done.
        workers: processes that walks are smoothed in, one a core if None; with 0 it is done in this one.

    Raises:
        DataError: no walk, no step, no known length, or one that cannot be the steps'.
    """
    if not walks:
        raise DataError("nothing to calibrate with: name at least one log")
    for walk in walks:
        walk.require_length()
    shown: list[_Shown | None] = [None] * len(walks)
    for outcome in run_tasks(partial(_smoothed, config=config), walks, workers):
        shown[outcome.number] = outcome.required()
        progress(walks[outcome.number].log.name)
    found = [one for one in shown if one is not None]
    wearer = fit_wearer([one.legs for one in found], config.step_length)
    device = fit_device([one.device for one in found], config.graph.sigma_gyro_scale)
    notes = [*(doubt for one in found for doubt in one.doubts), *_remarks(wearer)]
    return Calibration(device.applied(wearer.applied(config)), wearer, device, tuple(notes))


@dataclass(frozen=True)
class _Shown:
    """What one walk shows: its lengths, its device, and why neither may be believed."""

    legs: Legs
    device: SeenDevice
    doubts: tuple[str, ...]


def _smoothed(walk: KnownWalk, config: Config) -> _Shown:
    its = with_declination(config, walk.told.place, walk.log.t0_s)
    result = reconstruct(walk.log, its, replace(walk.told, truth=None, anchors=None))
    return _Shown(_legs_of(walk, result), _seen(walk, result), tuple(_doubts(result)))


def _legs_of(walk: KnownWalk, result: WalkResult) -> Legs:
    """What is known of a walk's lengths."""
    track, length, name = result.track, result.config.step_length, short_name(walk.log.name)
    if walk.distance_m is not None or walk.places is None:
        return leg_of_distance(name, track, walk.distance_m or 0.0, length)
    yaw_rad = result.trajectories[result.best].yaw_rad
    return legs_between(name, track, yaw_rad, walk.places.since(walk.log.t0_s), length)


def _seen(walk: KnownWalk, result: WalkResult) -> SeenDevice:
    """What a walk showed of the device; known places tell more of the gyroscope than the compass does."""
    seen = seen_device(result)
    if walk.distance_m is None and walk.places is not None:
        places = walk.places.since(walk.log.t0_s)
        scale, sigma = scale_by_places(result.track, places, result.config.graph)
        if not sigma >= seen.gyro_scale_sigma:  # nor if the compass tells nothing
            return replace(seen, gyro_scale=scale, gyro_scale_sigma=sigma)
    return seen


def _doubts(result: WalkResult) -> list[str]:
    """Why a walk's steps may be others than its legs'."""
    if result.integrity.verdict == "sound":
        return []
    reason = result.integrity.reasons[0]
    return [f"{short_name(result.log.name)} is {result.integrity.verdict}: {reason.sentence}"]


def _remarks(wearer: WearerFit) -> list[str]:
    """What the fit itself says against believing it."""
    said = [f"left out: {text}" for text in wearer.left_out[:_TOLD_AT_MOST]]
    if len(wearer.left_out) > _TOLD_AT_MOST:
        said.append(f"left out: {len(wearer.left_out) - _TOLD_AT_MOST} more; --json names all")
    checked = wearer.cross_validation
    if checked is None:
        said.append("nothing could be left out to check the fit: one length only; a second walk would tell")
    elif not wearer.better:
        said.append(
            f"on what was left out the fit does hardly better, or worse, than the step length as it was "
            f"({checked.fitted_rel:.1%} against {checked.shipped_rel:.1%}), which is kept"
        )
    return said
