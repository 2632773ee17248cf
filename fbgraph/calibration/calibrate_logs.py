"""Logs, and what is known of their lengths, read and calibrated with: what ``fbgraph calibrate`` does."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TypeVar

from fbgraph.calibration.calibrate import Calibration, KnownWalk, calibrate_walks
from fbgraph.core.aids import Told
from fbgraph.core.checkpoints import Checkpoints
from fbgraph.core.config import Config, load_config
from fbgraph.core.errors import ConfigError
from fbgraph.core.sensor_log import SensorLog
from fbgraph.pipeline import with_places
from fbgraph.readers import preset_of, read_log
from fbgraph.readers.cleaning import LogFile
from fbgraph.readers.places import read_checkpoints
from fbgraph.run.inputs import RunInputs

Log = str | Path | SensorLog | LogFile
"""A file, or what was read from one."""
Places = str | Path | Checkpoints
"""A file of places, or what was read from one."""
_MOST_M = 1e6


def calibrate(
    logs: Log | Sequence[Log],
    *,
    distance_m: float | Sequence[float] | None = None,
    truth: Places | Sequence[Places] | None = None,
    anchors: Places | Sequence[Places] | None = None,
    use_gnss: str = "none",
    config: str | Path | Config | None = None,
    overrides: Sequence[str] = (),
    format_name: str | None = None,
    max_size: int | None = None,
    layout: str | Path | None = None,
    rate_hz: float | None = None,
    workers: int | None = 0,
    progress: Callable[[str], None] = lambda name: None,
) -> Calibration:
    """Calibrate a wearer's step length and a device from walks of known length or between known places.

    The step length's coefficients are fitted by least squares, as many as the walks tell; a single distance tells how
    much longer this wearer's steps are. Hard iron and gyroscope scale are found where the walks turn enough.

    Args:
        logs: one or more walks of one wearer with one device.
        distance_m: metres walked in each log, from its first step to its last; one for all, or one a log.
        truth, anchors: known places of each, in any frame of metres; those that a log carries if nothing is named.
        use_gnss: ``all`` takes the log's own fixes.
        config: a preset, a TOML file or a configuration; its step length is where fitting starts. The preset of the
            logs' format if None.
        overrides: ``a.b=value`` strings, as ``--set`` takes them.
        format_name, max_size, layout, rate_hz: how logs are read, as of ``smooth``.
        workers: processes that smooth the walks, one a core if None; with 0 it is done in this one.
        progress: told the name of each walk that is done.

    Returns:
        What was found; ``save`` writes the file that ``--config`` takes.

    Raises:
        ConfigError: no such preset or key, several kinds of known length, or more or fewer of them than logs.
        DataError: a log without steps or known length, too few steps, a length that cannot be theirs.
    """
    all_logs = [logs] if isinstance(logs, str | Path | SensorLog | LogFile) else list(logs)
    if sum(known is not None for known in (distance_m, truth, anchors)) + (use_gnss != "none") > 1:
        raise ConfigError("--distance, --truth, --anchors and --use-gnss: name one kind of known length")
    metres = [float(distance_m)] if isinstance(distance_m, int | float) else list(distance_m or ())
    for one in metres:
        if not 0.0 < one < _MOST_M:
            raise ConfigError(f"--distance {one:g}: expected the metres walked in a log")
    distances = _one_each("--distance", metres * (len(all_logs) if len(metres) == 1 else 1), len(all_logs))
    truths, all_anchors = (
        _one_each(
            option, [places] if isinstance(places, str | Path | Checkpoints) else list(places or ()), len(all_logs)
        )
        for option, places in (("--truth", truth), ("--anchors", anchors))
    )
    walks: list[KnownWalk] = []
    presets: dict[str, str] = {}
    for log, distance, its_truth, its_anchors in zip(all_logs, distances, truths, all_anchors, strict=True):
        inputs = RunInputs.of(
            log=Path(log) if isinstance(log, str | Path) else None,
            format_name=format_name,
            max_size=max_size,
            use_gnss=use_gnss,
            layout=None if layout is None else Path(layout),
            rate_hz=rate_hz,
        )
        file = _log_file(log, inputs)
        presets.setdefault(preset_of(file), file.log.name)
        read, told = with_places(file, Told(truth=_places(its_truth), anchors=_places(its_anchors)), inputs)
        walks.append(KnownWalk(read, told, distance))
    return calibrate_walks(walks, _configuration(config, presets, overrides), progress, workers)


def _configuration(config: str | Path | Config | None, presets: dict[str, str], overrides: Sequence[str]) -> Config:
    """The one that is named; else that of the logs' device, which is the same for all."""
    if isinstance(config, Config):
        if overrides:
            raise ConfigError("overrides go with a preset or a file; change a Config with model_copy")
        return config
    if config is None and len(presets) > 1:
        named = ", ".join(f"{name} of {log}" for name, log in presets.items())
        raise ConfigError(f"logs of several kinds of device ({named}): calibrate each by itself, or name --config")
    return load_config(config or next(iter(presets)), overrides)


T = TypeVar("T")


def _one_each(option: str, given: Sequence[T], count: int) -> list[T | None]:
    """One for each log, or none for any.

    Raises:
        ConfigError: another number of them.
    """
    if given and len(given) != count:
        raise ConfigError(f"{option}: {len(given)} for {count} logs; name one a log, in their order")
    return list(given) or [None] * count


def _log_file(log: Log, inputs: RunInputs) -> LogFile:
    if isinstance(log, LogFile):
        return log
    if isinstance(log, SensorLog):
        return LogFile(log, None)
    return read_log(log, inputs.format, inputs.max_size, layout=inputs.layout, rate_hz=inputs.rate_hz)


def _places(places: Places | None) -> Checkpoints | None:
    return read_checkpoints(places) if isinstance(places, str | Path) else places
