"""What is known of a building before a walk: which way its corridors run, and what Earth's field usually is in it."""

from __future__ import annotations

import math
from typing import Annotated, Literal

from pydantic import Field, model_validator

from fbgraph.core.sections import Section

QUARTER_RAD = math.pi / 2.0
"""Corridors at right angles: a direction is known up to this."""
DEFAULT_SIGMA_DEG = 2.0
"""Of an axis that somebody read off a plan."""
SIGMAS_DEG = (0.1, 20.0)
"""Between these: nobody knows it better, and worse is of no use."""


class BuildingAxis(Section):
    """Which way corridors run, at right angles to one another."""

    heading_deg: Annotated[float, Field(ge=-360.0, le=360.0)]
    """Compass heading of any of them, clockwise from North; only its remainder by 90 matters."""
    sigma_deg: Annotated[float, Field(ge=SIGMAS_DEG[0], le=SIGMAS_DEG[1])] = DEFAULT_SIGMA_DEG
    """Its standard deviation."""
    north: Literal["walk", "magnetic", "true"] = "walk"
    """Which North: magnetic, true, or that of the walk it is used for (true where its declination is known)."""
    declination_deg: Annotated[float | None, Field(ge=-180.0, le=180.0)] = None
    """With which it came to be counted from true North, positive East."""

    @model_validator(mode="after")
    def _known_north(self) -> BuildingAxis:
        if (self.north == "true") != (self.declination_deg is not None):
            raise ValueError('axis: north = "true" and declination_deg go together')
        return self

    def yaw_rad(self, declination_deg: float | None) -> float:
        """Counter-clockwise from the East of a walk, in [0, π/2).

        Args:
            declination_deg: by which the walk's compass was turned to true North; None if it was not.
        """
        heading_deg = self.heading_deg
        if self.north == "magnetic":
            heading_deg += declination_deg or 0.0
        elif self.declination_deg is not None and declination_deg is None:
            heading_deg -= self.declination_deg
        return -math.radians(heading_deg) % QUARTER_RAD


class BuildingField(Section):
    """Earth's field as it usually is inside: the median walk, and by how much walks differ from it."""

    strength_ut: Annotated[float, Field(gt=0.0, le=1000.0)]
    sigma_strength_ut: Annotated[float, Field(gt=0.0, le=1000.0)]
    dip_deg: Annotated[float, Field(ge=-90.0, le=90.0)]
    """Below the horizon."""
    sigma_dip_deg: Annotated[float, Field(gt=0.0, le=90.0)]


class Building(Section):
    """What is known of a building; nothing of it is used unless somebody names it."""

    axis: BuildingAxis
    field: BuildingField | None = None
    walks: Annotated[int, Field(ge=0)] = 0
    """From how many it was learned; 0 if somebody said so."""
