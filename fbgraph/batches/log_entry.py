"""A log of a batch, and what is said of it; a task is that and where its run goes."""

from __future__ import annotations

from dataclasses import asdict, dataclass, fields
from pathlib import Path
from typing import Any

from fbgraph.core.georeference import Georeference
from fbgraph.run.inputs import RunInputs

RUNS = "runs"
"""Folder of the run folders of a batch."""
MANIFEST, OPTIONS = "manifest.csv", "options.json"
"""Files of a batch: its logs, and what was said of all of them."""


@dataclass(frozen=True, slots=True)
class LogEntry:
    """One log.

    Attributes:
        log: its place: a path, or an address that fsspec knows.
        name: what its run folder is called; ``""`` until that is settled.
        truth, anchors: places of known places.
        config: a preset or the place of a TOML file, of this log alone; None for what the whole batch has.
    """

    log: str
    name: str = ""
    truth: str | None = None
    anchors: str | None = None
    config: str | None = None


@dataclass(frozen=True)
class BatchOptions:
    """What ``fbgraph smooth`` takes, for all logs of a batch.

    Attributes:
        config: a preset or the place of a TOML file; the preset of each log's format if None.
        overrides: ``a.b=value`` strings.
        format, use_gnss, closed_walk, origin, max_size, forced, layout, rate_hz, building, building_axis: as of
            ``RunInputs``.
        recording: whether to write ``recording.rrd``.
    """

    config: str | None = None
    overrides: tuple[str, ...] = ()
    format: str | None = None
    use_gnss: str = "none"
    closed_walk: bool = False
    origin: tuple[float, float] | None = None
    max_size: int | None = None
    forced: bool = False
    layout: str | None = None
    rate_hz: float | None = None
    building: str | None = None
    building_axis: str | None = None
    recording: bool = True

    def inputs(self, **files: Path | None) -> RunInputs:
        """As of a walk with these ``log``, ``truth``, ``anchors``, ``layout`` and ``building``.

        Raises:
            ConfigError: what cannot be meant.
        """
        return RunInputs.of(
            files.get("log"),
            self.format,
            files.get("truth"),
            files.get("anchors"),
            self.closed_walk,
            None if self.origin is None else Georeference(*self.origin),
            self.max_size,
            self.forced,
            self.use_gnss,
            files.get("layout"),
            self.rate_hz,
            files.get("building"),
            self.building_axis,
        )

    def as_dict(self) -> dict[str, Any]:
        """For JSON."""
        noted = asdict(self)
        return {name: list(value) if isinstance(value, tuple) else value for name, value in noted.items()}

    def first_difference(self, noted: dict[str, Any]) -> str:
        """The option that is not as it was noted; ``""`` if all are."""
        mine = self.as_dict()
        return next((one.name for one in fields(self) if mine[one.name] != noted.get(one.name)), "")


@dataclass(frozen=True, slots=True)
class BatchTask:
    """A log to be smoothed.

    Attributes:
        entry: the log.
        options: of the batch.
        out: place of the batch.
        resume: whether a run that is done and whole stays as it is.
    """

    entry: LogEntry
    options: BatchOptions
    out: str
    resume: bool = False
