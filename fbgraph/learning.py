"""What walks in one building tell of it, without truth: its axis, and Earth's field inside."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np

from fbgraph.core.building import SIGMAS_DEG, Building, BuildingAxis, BuildingField
from fbgraph.core.config import load_config
from fbgraph.core.earth_field import with_declination
from fbgraph.core.errors import DataError
from fbgraph.core.geometry import FloatArray
from fbgraph.core.georeference import Georeference
from fbgraph.estimators.building_axis import straight_legs
from fbgraph.estimators.learned_axis import LearnedAxis, learn_axis, votes_of
from fbgraph.front_end.step_track import StepTrack
from fbgraph.pipeline import reconstruct
from fbgraph.readers import preset_of, read_log
from fbgraph.run.walk_result import WalkResult
from fbgraph.workers.run_tasks import run_tasks

_CLEAR = 3.0  # logarithm of the odds for one axis against none; 1 % of sets of walks without an axis reach it
_MANY = 10
_FEW_STEPS = 20  # with a compass
_FEW_FIELDS = 3
_LEAST_UT, _LEAST_DEG = 1.0, 1.0
_TO_SIGMA = 1.4826  # a median absolute deviation, of normal numbers
_ONE_PLACE_DEG = 1.0
_MOST_NAMED = 3


@dataclass(frozen=True)
class WalkInBuilding:
    """What one walk tells of its building.

    Attributes:
        name: of the log.
        votes: for each axis, counted from magnetic North; None of one that bends most of the way.
        declination_deg: by which its compass was turned to true North; None if it was not.
        strength_ut, dip_rad: medians of the field at its steps; nan of a walk without a compass.
    """

    name: str
    votes: FloatArray | None
    declination_deg: float | None
    strength_ut: float
    dip_rad: float


@dataclass(frozen=True)
class LearnedBuilding:
    """A building, and what it was learned from.

    Attributes:
        building: as ``fbgraph smooth --building`` takes it.
        log_odds: logarithm of the odds that the walks have one axis in common, against none.
        walks: names of those that told of it.
        notes: which did not, and what else is worth telling.
    """

    building: Building
    log_odds: float
    walks: tuple[str, ...]
    notes: tuple[str, ...] = ()


def learn_building(
    logs: Sequence[str | Path],
    *,
    config: str | Path | None = None,
    overrides: Sequence[str] = (),
    origin: tuple[float, float] | None = None,
    workers: int | None = 0,
    progress: Callable[[str, float], None] = lambda name, share: None,
) -> LearnedBuilding:
    """Learn a building's axis, and Earth's field in it, from walks without truth.

    Ten walks or more; of fewer the axis is less well known, which is said, or not to be told.

    Args:
        logs: of walks in one building.
        config: a preset or a TOML file; the preset of each log's format if None.
        overrides: ``a.b=value`` strings, as ``--set`` takes them.
        origin: latitude and longitude of the building, degrees: its axis is then counted from true North.
        workers: processes that smooth them, one a core if None; with 0 it is done in this one.
        progress: told the name of each log that is smoothed, and which share of them is done.

    Raises:
        ConfigError: a wrong option.
        DataError: no log could be used, or the walks show no axis.
    """
    where = None if origin is None else Georeference(*origin)
    load_config(None if config is None else str(config), overrides)
    paths, outcomes = [Path(log) for log in logs], []
    walked = partial(_walked, config=None if config is None else str(config), overrides=tuple(overrides), where=where)
    for outcome in run_tasks(walked, paths, workers):
        outcomes.append(outcome)
        progress(paths[outcome.number].name, len(outcomes) / len(paths))
    outcomes.sort(key=lambda one: one.number)
    walks = [one.value for one in outcomes if one.value is not None]
    notes = [f"left out: {one.reason}" for one in outcomes if one.cause]
    learned = building_of(walks)
    return LearnedBuilding(learned.building, learned.log_odds, learned.walks, (*notes, *learned.notes))


def _walked(log: Path, config: str | None, overrides: Sequence[str], where: Georeference | None) -> WalkInBuilding:
    """One walk, smoothed.

    Raises:
        FbgraphError: it cannot be, or is withheld.
    """
    file = read_log(log)
    effective = with_declination(load_config(config or preset_of(file), overrides), where, file.log.t0_s, log)
    result = reconstruct(file.log, effective)
    if "smoothed" in result.failed:
        raise DataError(f"{log}: {result.failed['smoothed']}")
    return walk_in_building(result, log.name)


def walk_in_building(result: WalkResult, name: str = "") -> WalkInBuilding:
    """What a reconstructed walk, which was not told of the building, tells of it."""
    declination_deg = result.config.device.declination_deg
    legs = straight_legs(result.smoothed.trajectory)
    compass = np.isfinite(result.track.yaw_mag_rad).any()
    votes = votes_of(legs.turned(math.radians(declination_deg or 0.0))) if compass and len(legs.yaw_rad) else None
    strength_ut, dip_rad = _field_medians(result.track)
    return WalkInBuilding(name or result.log.name, votes, declination_deg, strength_ut, dip_rad)


def _field_medians(track: StepTrack) -> tuple[float, float]:
    known = np.isfinite(track.mag_norm_ut) & np.isfinite(track.mag_dip_rad)
    if known.sum() < _FEW_STEPS:
        return math.nan, math.nan
    return float(np.median(track.mag_norm_ut[known])), float(np.median(track.mag_dip_rad[known]))


def building_of(walks: Sequence[WalkInBuilding]) -> LearnedBuilding:
    """What walks have in common; see ``learn_building``.

    Raises:
        DataError: no walk has a compass and straight legs, or they show no axis.
    """
    telling = [(walk, walk.votes) for walk in walks if walk.votes is not None]
    notes = []
    if silent := [walk.name for walk in walks if walk.votes is None]:
        more = ", …" if len(silent) > _MOST_NAMED else ""
        names = ", ".join(silent[:_MOST_NAMED]) + more
        notes.append(f"{len(silent)} walk(s) without a compass, or that bend most of the way, tell no axis: {names}")
    if not telling:
        raise DataError(
            "no axis: none of the logs is a walk with a compass that goes straight for most of its way" + _told(notes)
        )
    found = learn_axis([votes for _, votes in telling])
    if found.log_odds < _CLEAR:
        raise DataError(_no_axis(found, len(telling)))
    if len(telling) < _MANY:
        notes.append(
            f"from {len(telling)} walks the axis is known to {math.degrees(found.sigma_rad):.1f}° only: learn it from "
            f"{_MANY} or more"
        )
    axis = _axis_of(found, [walk.declination_deg for walk, _ in telling])
    building = Building(axis=axis, field=_field_of(walks), walks=len(telling))
    return LearnedBuilding(building, found.log_odds, tuple(walk.name for walk, _ in telling), tuple(notes))


def _told(notes: Sequence[str]) -> str:
    return f" ({'; '.join(notes)})" if notes else ""


def _no_axis(found: LearnedAxis, count: int) -> str:
    """Why walks show no axis, and what to do."""
    why = f"an axis in common is only {math.exp(found.log_odds):.1f} times likelier than none"
    if found.log_odds < 0.0:
        why = "their straight legs lie in all directions"
    advice = "there may be none, as in a park or an old town, or they are of several buildings"
    if count < _MANY:
        advice = f"learn it from {_MANY} walks or more" if found.log_odds > 0.0 else f"{advice}; more walks may tell"
    return f"{count} walk{'s show' if count > 1 else ' shows'} no axis: {why}; {advice}"


def _axis_of(found: LearnedAxis, declinations_deg: Sequence[float | None]) -> BuildingAxis:
    """The axis from true North if all walks knew it, else from magnetic North; votes are from the latter."""
    known = [one for one in declinations_deg if one is not None]
    heading_deg = 90.0 - math.degrees(found.yaw_rad)
    sigma_deg = round(min(max(math.degrees(found.sigma_rad), SIGMAS_DEG[0]), SIGMAS_DEG[1]), 2)
    if len(known) < len(declinations_deg) or np.ptp(known) > _ONE_PLACE_DEG:
        return BuildingAxis(heading_deg=round(heading_deg % 90.0, 2), sigma_deg=sigma_deg, north="magnetic")
    declination_deg = float(np.median(known))
    heading_deg = round((heading_deg + declination_deg) % 90.0, 2)
    return BuildingAxis(heading_deg=heading_deg, sigma_deg=sigma_deg, north="true", declination_deg=declination_deg)


def _field_of(walks: Sequence[WalkInBuilding]) -> BuildingField | None:
    """The median walk's field, and by how much walks differ from it; None of a few."""
    fields = np.array([(walk.strength_ut, math.degrees(walk.dip_rad)) for walk in walks]).reshape(-1, 2)
    fields = fields[np.isfinite(fields).all(axis=1)]
    if len(fields) < _FEW_FIELDS:
        return None
    usual = np.median(fields, axis=0)
    spread = np.maximum(_TO_SIGMA * np.median(np.abs(fields - usual), axis=0), (_LEAST_UT, _LEAST_DEG))
    (strength_ut, dip_deg), (sigma_ut, sigma_deg) = usual.round(2).tolist(), spread.round(2).tolist()
    return BuildingField(strength_ut=strength_ut, sigma_strength_ut=sigma_ut, dip_deg=dip_deg, sigma_dip_deg=sigma_deg)
