"""What a run was made from, as its summary notes it: enough to make it again."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass, fields
from pathlib import Path
from typing import Any

from fbgraph.core.building import Building
from fbgraph.core.building_files import parse_building_axis, read_building
from fbgraph.core.errors import ConfigError, DataError
from fbgraph.core.georeference import Georeference
from fbgraph.core.gnss_fixes import require_gnss_use

_PIPED = "piped"
"""What of truth, anchors, layout and building was a pipe: a run without them would be another one."""
RATES_HZ = (0.1, 10_000.0)
"""Of samples, as ``--rate`` takes them."""


@dataclass(frozen=True)
class RunInputs:
    """What was read and asked for.

    Attributes:
        log: path of the log; ``raw.csv`` if it is in the run folder itself; None if there was no file.
        format: name of its format, None if that was found by content.
        truth, anchors: paths of checkpoint files.
        closed_walk: whether the walk was said to end where it began.
        origin: latitude and longitude of its start, degrees.
        online_chunk_s: length of the pieces in which it was fed to the online smoother; None if it was not.
        until_s: seconds since log start at which a replay was stopped; None if it was not.
        max_size: bytes of the log's text that may be read; None for what any walk keeps within.
        forced: the smoothed walk is wanted even where its own check withholds it.
        use_gnss: which of the log's own fixes are anchors: one of ``gnss_fixes.GNSS_USES``.
        layout: path of the file that says what the columns of its tables are; None if that was found.
        rate_hz: of the samples, where the user said so.
        building: path of what is known of the building.
        building_axis: its axis as ``--building-axis`` takes it.
    """

    log: str | None = None
    format: str | None = None
    truth: str | None = None
    anchors: str | None = None
    closed_walk: bool = False
    origin: tuple[float, float] | None = None
    online_chunk_s: float | None = None
    until_s: float | None = None
    max_size: int | None = None
    forced: bool = False
    use_gnss: str = "none"
    layout: str | None = None
    rate_hz: float | None = None
    building: str | None = None
    building_axis: str | None = None

    @staticmethod
    def of(
        log: Path | None,
        format_name: str | None = None,
        truth: Path | None = None,
        anchors: Path | None = None,
        closed_walk: bool = False,
        origin: Georeference | None = None,
        max_size: int | None = None,
        forced: bool = False,
        use_gnss: str = "none",
        layout: Path | None = None,
        rate_hz: float | None = None,
        building: Path | None = None,
        building_axis: str | None = None,
    ) -> RunInputs:
        """What somebody named; paths are kept so that they hold from anywhere.

        Raises:
            ConfigError: GNSS is to be used in a way that there is not, or beside other anchors; a rate or an axis that
                is none, or an axis beside a building's own.
        """
        if building_axis is not None:
            parse_building_axis(building_axis)
            if building is not None:
                raise ConfigError("--building knows its axis: leave out --building-axis")
        if require_gnss_use(use_gnss) != "none" and anchors is not None:
            raise ConfigError("--use-gnss makes anchors of the log's fixes: leave out --anchors")
        if rate_hz is not None and not RATES_HZ[0] <= rate_hz <= RATES_HZ[1]:
            low, high = RATES_HZ
            raise ConfigError(f"--rate {rate_hz:g}: expected the samples a second, {low:g} to {high:g}")
        return RunInputs(
            log=_lasting(log),
            format=format_name,
            truth=_lasting(truth),
            anchors=_lasting(anchors),
            closed_walk=closed_walk,
            origin=None if origin is None else (origin.lat_deg, origin.lon_deg),
            max_size=max_size,
            forced=forced,
            use_gnss=use_gnss,
            layout=_lasting(layout),
            rate_hz=rate_hz,
            building=_lasting(building),
            building_axis=building_axis,
        )

    def building_told(self) -> Building | None:
        """What the user says of the building; None if nothing.

        Raises:
            ConfigError: a file that cannot be used, or an axis that is none.
        """
        if self.building is not None:
            return read_building(Path(self.building))
        return None if self.building_axis is None else parse_building_axis(self.building_axis)

    @staticmethod
    def from_summary(summary: Mapping[str, Any], run: Path) -> RunInputs:
        """What a run's summary, which is checked, notes; what a newer fbgraph noted beside it is left out.

        Raises:
            DataError: nothing, or something that was there only once.
        """
        noted = summary.get("inputs") or {}
        if not noted.get("log"):
            raise DataError(
                f"{run}: by its summary.json its log was no file, or an earlier fbgraph did not note it; "
                "smooth the log again"
            )
        if piped := noted.get(_PIPED):
            raise DataError(
                f"{run}: its {' and '.join(piped)} came through a pipe and cannot be read again; smooth the log again, "
                f"with a file as {' and '.join(f'--{name}' for name in piped)}"
            )
        known = {field.name: noted[field.name] for field in fields(RunInputs) if field.name in noted}
        origin = known.get("origin")
        return RunInputs(**{**known, "origin": None if origin is None else (float(origin[0]), float(origin[1]))})

    def as_dict(self) -> dict[str, Any]:
        """For ``summary.json``; what concerns replays only of a replay, and no path of what was a pipe."""
        noted = asdict(self)
        piped = [
            name
            for name in ("log", "truth", "anchors", "layout", "building")
            if noted[name] and _is_pipe(Path(noted[name]))
        ]
        noted.update(dict.fromkeys(piped))
        if aids := [name for name in piped if name != "log"]:
            noted[_PIPED] = aids
        if self.max_size is None:
            del noted["max_size"]
        if not self.forced:
            del noted["forced"]
        if self.use_gnss == "none":
            del noted["use_gnss"]
        for name in ("layout", "rate_hz", "building", "building_axis"):
            if noted[name] is None:
                del noted[name]
        if self.origin is not None:
            noted["origin"] = list(self.origin)
        if self.online_chunk_s is None:
            del noted["online_chunk_s"], noted["until_s"]
        return noted


def _lasting(path: Path | None) -> str | None:
    """A path that holds from anywhere; a pipe's name, ``/dev/stdin``, leads nowhere once it is resolved."""
    if path is None:
        return None
    return str(path.absolute() if _is_pipe(path) else path.resolve())


def _is_pipe(path: Path) -> bool:
    try:
        return not path.is_file() and path.is_fifo()
    except ValueError:  # a NUL in its name
        return False
