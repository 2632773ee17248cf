"""One log inspected: tables, sensors, field, wear, what ``smooth`` would say."""

from __future__ import annotations

import shlex
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from fbgraph.columns.choosing import choose
from fbgraph.columns.clock_times import Clock
from fbgraph.core.aids import Told
from fbgraph.core.config import load_config
from fbgraph.core.earth_field import EarthField, earth_field, walk_day
from fbgraph.core.errors import DataError
from fbgraph.core.geometry import FloatArray
from fbgraph.core.sensor_log import Stream
from fbgraph.front_end.detect_steps import found_steps
from fbgraph.front_end.levelled_signals import LevelledSignals
from fbgraph.inspection.columns_told import guesses_of, tables_told, used_by_choice, used_by_reading
from fbgraph.inspection.field_told import field_told
from fbgraph.inspection.readable import Readable, readable_streams, tagged_streams
from fbgraph.inspection.streams_told import Span, gaps, rest_told, still_spans, streams_told
from fbgraph.inspection.wear import Wear, worn
from fbgraph.pipeline import reconstruct, with_places
from fbgraph.readers import Contents, contents, layout_of, log_of, preset_of
from fbgraph.readers.cleaning import LogFile, log_name
from fbgraph.readers.layout import Layout
from fbgraph.readers.reading import Reading
from fbgraph.run.inputs import RunInputs
from fbgraph.run.summary import warnings
from fbgraph.tables.table import Table

_JUMPS = ("clock_restarts", "rows_reordered", "acc_not_later", "acc_stray_time", "acc_impossible_time")


@dataclass(frozen=True)
class Inspection:
    """What was found.

    Attributes:
        report: for JSON, units in its keys; ``cli`` prints the same.
        name: of the log.
        streams: by quantity, SI, seconds since log start.
        still, gaps: begin and end, seconds.
        steps_s: (K,) when steps ended.
        layout: by which its tables were read; None where the format tells, or nothing could be read.
    """

    report: dict[str, Any]
    name: str
    streams: Mapping[str, Stream]
    still: list[Span]
    gaps: list[Span]
    steps_s: FloatArray
    layout: Layout | None


def inspect_log(inputs: RunInputs) -> Inspection:
    """Inspect a log; what can be said is said of one that ``smooth`` would refuse, too.

    Args:
        inputs: log, format, layout, rate and size as named.

    Raises:
        DataError: there is nothing in it, or it cannot be read.
        ConfigError: a format or layout that is none.
    """
    path = Path(str(inputs.log))
    laid_out = layout_of(path, inputs.layout)
    found = contents(path, inputs.format, inputs.max_size)
    file, refusal = None, ""
    try:
        file = log_of(found, inputs.format, laid_out, inputs.rate_hz)
    except DataError as error:
        refusal = str(error)
    reading = None if file is None else file.reading
    guesses = guesses_of(found.tables, reading)
    chosen = choose(found.tables, guesses) if reading is None or not reading.chosen.picks else reading.chosen
    if file is not None:
        named = {name: getattr(file.log, name) for name in ("acc", "gyro", "mag", "pressure")}
        readable = Readable({name: stream for name, stream in named.items() if len(stream)})
    elif found.tagged is not None:
        readable = Readable(tagged_streams(found.tagged[1]))
    else:
        readable = readable_streams(found.tables, guesses, chosen, inputs.rate_hz)
        refusal = "; ".join(dict.fromkeys((refusal, *readable.hindrances)))
    clocks: Mapping[int, Clock] = readable.clocks if reading is None else reading.clocks
    streams = {name: stream for name, stream in readable.streams.items() if name not in readable.unscaled}
    used = used_by_choice(chosen) if reading is None else used_by_reading(found.tables, reading, path)
    used |= {(i, column): "time" for i, clock in clocks.items() for column in clock.columns}
    smoothed = _smoothed(file, inputs) if file is not None else _Smoothed("refused", {"reasons": [refusal]})
    still = still_spans(smoothed.signals, streams.get("acc"))
    holes = gaps(streams["acc"]) if "acc" in streams else []
    report = {
        "log": _log(path, found, file),
        "tables": tables_told(found.tables, guesses, chosen, used),
        "left_out": [{"source": source, "why": why} for source, why in found.left_out],
        "clocks": [_clock(found.tables, i, clock) for i, clock in clocks.items()],
        "physics": {} if reading is None or laid_out is not None else _physics(reading),
        "sensors": streams_told(readable.streams, readable.unscaled),
        "clock_jumps": {} if file is None else {why: file.log.counts[why] for why in _JUMPS if why in file.log.counts},
        "counts": {} if file is None else dict(file.log.counts),
        "rest": rest_told(still, streams.get("gyro")),
        "field": field_told(streams, None if file is None else _expected(file, path)),
        "worn": {name: value if value == value else None for name, value in vars(smoothed.wear).items()},
        "smooth": {"verdict": smoothed.verdict, **smoothed.told},
        "next": next_command(inputs, path),
    }
    layout = None if reading is None else reading.layout
    return Inspection(report, log_name(path), streams, still, holes, smoothed.steps_s, layout)


@dataclass(frozen=True)
class _Smoothed:
    """What ``smooth`` would say."""

    verdict: str
    told: dict[str, Any]
    signals: LevelledSignals | None = None
    steps_s: FloatArray = field(default_factory=lambda: np.empty(0))
    wear: Wear = field(default_factory=lambda: Wear("not told", "it cannot be smoothed"))


def _smoothed(file: LogFile, inputs: RunInputs) -> _Smoothed:
    config = load_config(preset_of(file))
    rate_hz = config.attitude.rate_hz
    try:
        log, told = with_places(file, Told(), inputs)
        result = reconstruct(log, config, told, inputs)
    except DataError as error:
        _, signals = found_steps(file.log, config)
        told_of = {"reasons": [str(error)], "steps": 0}
        return _Smoothed("refused", told_of, signals, wear=worn(signals, rate_hz))
    integrity = result.integrity
    told_of = {
        "reasons": [reason.sentence for reason in integrity.reasons],
        "steps": len(result.track) - 1,
        "distance_m": round(float(result.trajectories[result.best].distance_m[-1]), 2),
        "notes": warnings(result),
        "assumed": [] if file.reading is None else list(file.reading.assumed),
    }
    verdict = "failed" if "smoothed" in result.failed and integrity.verdict != "withheld" else integrity.verdict
    return _Smoothed(verdict, told_of, result.signals, result.track.t_s[1:], worn(result.signals, rate_hz))


def _log(path: Path, found: Contents, file: LogFile | None) -> dict[str, Any]:
    told: dict[str, Any] = {"path": str(path), "name": log_name(path)}
    told["format"] = found.tagged[0] if found.tagged is not None else None if file is None else file.log.format
    told["duration_s"] = None if file is None else round(file.log.duration_s, 3)
    told["preset"] = None if file is None else preset_of(file)
    told["truth"] = None if file is None or file.truth is None else f"{len(file.truth)} places"
    told["gnss"] = None if file is None or file.gnss is None else f"{len(file.gnss)} fixes"
    return told


def _clock(tables: list[Table], i: int, clock: Clock) -> dict[str, Any]:
    return {
        "table": tables[i].name,
        "columns": [tables[i].columns[k].name or f"#{k + 1}" for k in clock.columns],
        "kind": clock.kind,
        "tick_ns": clock.tick_ns,
        "wraps_at": clock.wrap or None,
        "why": clock.why,
        "note": clock.text,
    }


def _physics(reading: Reading) -> dict[str, Any]:
    """What the sensors themselves showed of units and axes."""
    told = {}
    for name in reading.layout.streams:
        judgement = getattr(reading.judged, name)
        if judgement is not None:
            told[name] = {
                "unit": judgement.unit,
                "scale_to_si": judgement.scale,
                "axes": list(judgement.signed_axes) if name != "pressure" else [],
                "by": judgement.by,
                "sure": judgement.sure,
                "sigmas": round(judgement.margin, 1) if np.isfinite(judgement.margin) else None,
                "said": judgement.text,
            }
    return {**told, "axes_told": reading.judged.axes_told}


def _expected(file: LogFile, path: Path) -> EarthField | None:
    """Earth's field where the log's own places say that it was recorded."""
    for places in (file.truth, file.gnss):
        if places is not None and places.first is not None:
            return earth_field(places.first, walk_day(file.log.t0_s, path))
    return None


def next_command(inputs: RunInputs, path: Path) -> str:
    """``fbgraph smooth`` as it would be typed for this log, read in the same way."""
    words = ["fbgraph", "smooth", str(path)]
    for option, value in (("--format", inputs.format), ("--layout", inputs.layout), ("--max-size", inputs.max_size)):
        words += [] if value is None else [option, str(value)]
    words += [] if inputs.rate_hz is None else ["--rate", f"{inputs.rate_hz:g}"]
    return shlex.join(words)
