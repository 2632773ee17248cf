"""What the summary of a run notes, as far as anybody reads it: checked where it enters.

Fields that nobody reads are not looked at, so that summaries of older and newer versions are read; those that came
later than others may be missing.
"""

from __future__ import annotations

import reprlib
from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import AfterValidator, BaseModel, ConfigDict, Field, InstanceOf, ValidationError

from fbgraph.core.errors import DataError
from fbgraph.core.verdict import Verdict


def _without_nul(text: str) -> str:
    if "\x00" in text:
        raise ValueError("it holds a NUL")
    return text


_Shown = InstanceOf[str]
"""Any text: names of files that are no UTF-8 hold halves of surrogate pairs, which Pydantic's own ``str`` refuses."""
_Text = Annotated[_Shown, AfterValidator(_without_nul)]
_Count = Annotated[int, Field(ge=0, le=10**9)]
_Metres = Annotated[float, Field(ge=0.0, le=1e9)]
_Seconds = Annotated[float, Field(ge=0.0, le=1e9)]
_ClockSeconds = Annotated[float, Field(ge=-1e12, le=1e12)]
_Place = Annotated[list[float], Field(min_length=3, max_length=3)]
_Latitude = Annotated[float, Field(ge=-90.0, le=90.0)]
_Longitude = Annotated[float, Field(ge=-180.0, le=180.0)]


class _Noted(BaseModel):
    """A part of the summary; ``"5"`` is no number, and what nobody reads is not looked at."""

    model_config = ConfigDict(strict=True, frozen=True, extra="ignore", allow_inf_nan=False)


class _Event(_Noted):
    t_s: _ClockSeconds
    label: _Shown


class _Samples(_Noted):
    mag: _Count = 1
    pressure: _Count = 1


class _Log(_Noted):
    name: _Shown
    duration_s: _Seconds
    t0_s: _ClockSeconds
    samples: _Samples = _Samples()
    events: list[_Event] | _Count = 0
    """Of early versions only how many there were."""


class _Score(_Noted):
    rmse_m: _Metres


class _Estimator(_Noted):
    distance_m: _Metres
    end_m: _Place
    score: _Score = _Score(rmse_m=0.0)
    """Missing where no truth is known, and never null."""


class _Georeference(_Noted):
    lat_deg: _Latitude
    lon_deg: _Longitude


class _Declination(_Noted):
    deg: Annotated[float, Field(ge=-180.0, le=180.0)]
    text: _Shown


class _Finding(_Noted):
    kind: _Shown
    start_s: float
    end_s: float
    text: _Shown


class _Reason(_Noted):
    kind: _Shown
    weight: float
    text: _Shown
    advice: _Shown
    start_s: float | None = None
    end_s: float | None = None


class _Integrity(_Noted):
    verdict: Verdict
    widened: Annotated[float, Field(ge=0.0)]
    reasons: list[_Reason]


class _Inputs(_Noted):
    log: _Text | None = None
    format: _Text | None = None
    truth: _Text | None = None
    anchors: _Text | None = None
    piped: list[_Text] = []
    closed_walk: bool = False
    origin: Annotated[list[float], Field(min_length=2, max_length=2)] | None = None
    online_chunk_s: Annotated[float, Field(ge=0.001, le=1e9)] | None = None
    until_s: _Seconds | None = None
    max_size: Annotated[int, Field(ge=1)] | None = None
    forced: bool = False
    use_gnss: Literal["none", "start", "ends", "all"] = "none"
    layout: _Text | None = None
    rate_hz: Annotated[float, Field(ge=0.1, le=10_000.0)] | None = None
    building: _Text | None = None
    building_axis: _Text | None = None


class _Axis(_Noted):
    used: bool


class NotedRun(_Noted):
    """The summary as its readers need it."""

    log: _Log
    estimators: Annotated[dict[Literal["pdr", "ekf", "smoothed", "online"], _Estimator], Field(min_length=1)]
    steps: _Count
    distance_m: _Metres
    walk_s: _Seconds | None = None
    altitude_range_m: Annotated[list[float], Field(min_length=2, max_length=2)] | None = None
    closed_walk: bool = False
    anchors: _Count = 0
    axis: _Axis | None = None
    georeference: _Georeference | None = None
    declination: _Declination | None = None
    findings: list[_Finding] = []
    integrity: _Integrity | None = None
    inputs: _Inputs | None = None
    sha256: dict[str, str] = {}


def noted_run(summary: Mapping[str, Any], path: Path) -> NotedRun:
    """Check a summary.

    Args:
        summary: as the file holds it.
        path: the file, for the message.

    Raises:
        DataError: naming the dotted path of the first field that is missing or wrong.
    """
    try:
        return NotedRun.model_validate(summary)
    except ValidationError as error:
        first = error.errors(include_url=False)[0]
        field = ".".join(str(part) for part in first["loc"])
        got = "" if first["type"] == "missing" else f" (got {reprlib.repr(first['input'])})"
        raise DataError(f"{path}: {field}: {first['msg']}{got}") from error
