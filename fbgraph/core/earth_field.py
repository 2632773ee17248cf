"""The Earth's magnetic field where a walk was: what its compass should see, and how far that is from true North.

By the World Magnetic Model of NOAA and the British Geological Survey (Chulliat et al., The US/UK World Magnetic Model
for 2020-2025, doi 10.25923/ytk1-yx35, and its successor), as ``pygeomag`` computes it, at sea level. Declination is
right to about 0.4°, what the crust adds not counted, and changes by 0.1° to 0.5° a year.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from datetime import UTC, date, datetime, timedelta
from pathlib import Path

from fbgraph.core.config import Config
from fbgraph.core.georeference import Georeference

_FIRST, _END = 2010, 2030  # years that the model's coefficients cover
_WEAK_UT = 2.0  # a horizontal field below this is the model's own "blackout zone"


@dataclass(frozen=True)
class EarthField:
    """The undisturbed field at a place on a day.

    Attributes:
        declination_deg: of magnetic North from true North, positive East.
        dip_rad: inclination below the horizon, positive on the northern hemisphere.
        strength_ut: of the whole field.
        where, day: the place and the day that were asked for.
        model: which coefficients, ``WMM-2025``.
        covered: whether they are meant for that day; else the nearest day that they are meant for was taken.
    """

    declination_deg: float
    dip_rad: float
    strength_ut: float
    where: Georeference
    day: date
    model: str
    covered: bool = True

    @property
    def level_ut(self) -> float:
        """Its horizontal part, which is all that a compass feels."""
        return self.strength_ut * math.cos(self.dip_rad)

    @property
    def text(self) -> str:
        """The declination and where it comes from, as it is told and written down."""
        place = f"{self.where.lat_deg:.4g}, {self.where.lon_deg:.4g}"
        notes = f"{self.model}, {self.day.isoformat()}" + ("" if self.covered else ", the nearest that it covers")
        weak = "; the field is all but vertical there, a compass is of little use" if self.level_ut < _WEAK_UT else ""
        return f"{degrees_text(self.declination_deg)} at {place} by the World Magnetic Model ({notes}){weak}"


def earth_field(where: Georeference, day: date) -> EarthField:
    """The field that the World Magnetic Model expects.

    Args:
        where: latitude and longitude.
        day: of a year from 2010 to 2029; outside of them the nearest is taken, and ``covered`` says so.
    """
    from pygeomag import GeoMag  # here, because only walks whose place is known need it

    begin = date(day.year, 1, 1)
    year = day.year + (day - begin).days / (date(day.year + 1, 1, 1) - begin).days
    nearest = min(max(year, float(_FIRST)), _END - 1e-3)
    model = GeoMag(base_year=math.floor(nearest))
    found = model.calculate(where.lat_deg, where.lon_deg, 0.0, nearest)
    return EarthField(
        declination_deg=float(found.d),
        dip_rad=math.radians(found.i),
        strength_ut=float(found.f) / 1000.0,
        where=where,
        day=day,
        model=str(model.model),
        covered=nearest == year,
    )


def walk_day(t0_s: float, file: Path | None = None) -> date:
    """The day of a walk (UTC): by its own clock if that can be the time of day, else by its file, else today.

    Args:
        t0_s: ``SensorLog.t0_s``; Unix seconds if the log's clock knows the date, nan if nobody knows it yet.
        file: the log's, whose last change is taken; of a pipe, or of a file that is gone, there is none.
    """
    now = datetime.now(UTC)
    try:
        changed_s = file.stat().st_mtime if file is not None and file.is_file() else math.nan
    except (OSError, ValueError):  # not ours to read, or a NUL in its name
        changed_s = math.nan
    earliest_s, latest_s = datetime(_FIRST, 1, 1, tzinfo=UTC).timestamp(), (now + timedelta(days=1)).timestamp()
    for seconds in (t0_s, changed_s):
        if earliest_s <= seconds <= latest_s:
            return datetime.fromtimestamp(seconds, UTC).date()
    return now.date()


def with_declination(config: Config, where: Georeference | None, t0_s: float, file: Path | None = None) -> Config:
    """The configuration, its declination looked up if nobody set it and the place is known.

    The value is rounded to a tenth of a degree, finer than the model knows it, so that a walk smoothed again from
    another copy of its file is the same walk.

    Args:
        config: what was asked for.
        where: somewhere along the walk, None if nobody knows.
        t0_s, file: of the log, for its day: as in ``walk_day``.
    """
    if where is None or config.device.declination_deg is not None:
        return config
    field = earth_field(where, walk_day(t0_s, file))
    known = {"declination_deg": round(field.declination_deg, 1) + 0.0, "declination_by": field.text}
    return config.model_copy(update={"device": config.device.model_copy(update=known)})


def declination_text(config: Config) -> str | None:
    """What a run's y axis is turned by from the compass's North, and who says so; None if by nothing."""
    declination_deg, by = config.device.declination_deg, config.device.declination_by
    if declination_deg is None:
        return None
    degrees = degrees_text(declination_deg)
    return f"declination {by if by.startswith(degrees) else f'{degrees}, as it was set'}"


def degrees_text(declination_deg: float) -> str:
    """A declination for people: ``15.1° East``."""
    return f"{abs(declination_deg):.1f}° {'West' if round(declination_deg, 1) < 0.0 else 'East'}"
