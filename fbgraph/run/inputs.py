"""What a run was made from, as its summary notes it: enough to make it again."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from fbgraph.core.errors import DataError
from fbgraph.core.georeference import Georeference


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
    """

    log: str | None = None
    format: str | None = None
    truth: str | None = None
    anchors: str | None = None
    closed_walk: bool = False
    origin: tuple[float, float] | None = None
    online_chunk_s: float | None = None
    until_s: float | None = None

    @staticmethod
    def of(
        log: Path | None,
        format_name: str | None = None,
        truth: Path | None = None,
        anchors: Path | None = None,
        closed_walk: bool = False,
        origin: Georeference | None = None,
    ) -> RunInputs:
        """What somebody named; paths are kept so that they hold from anywhere."""
        return RunInputs(
            log=None if log is None else str(log.resolve()),
            format=format_name,
            truth=None if truth is None else str(truth.resolve()),
            anchors=None if anchors is None else str(anchors.resolve()),
            closed_walk=closed_walk,
            origin=None if origin is None else (origin.lat_deg, origin.lon_deg),
        )

    @staticmethod
    def from_summary(summary: Mapping[str, Any], run: Path) -> RunInputs:
        """What a run's summary notes.

        Raises:
            DataError: nothing, or nothing that can be used.
        """
        noted = summary.get("inputs") or {}
        if not noted.get("log"):
            raise DataError(
                f"{run}: its log was not a file, or an earlier fbgraph did not note it; smooth the log again"
            )
        try:
            origin = noted.get("origin")
            return RunInputs(**{**noted, "origin": None if origin is None else (float(origin[0]), float(origin[1]))})
        except (TypeError, ValueError, IndexError) as error:
            raise DataError(f"{run}: its summary's inputs are damaged; smooth the log again") from error

    def as_dict(self) -> dict[str, Any]:
        """For ``summary.json``; what concerns replays only of a replay."""
        noted = asdict(self)
        if self.origin is not None:
            noted["origin"] = list(self.origin)
        if self.online_chunk_s is None:
            del noted["online_chunk_s"], noted["until_s"]
        return noted
