"""Rates, gaps, jumps and rails of each sensor, and when the device lay or was held still."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from typing import Any

import numpy as np

from fbgraph.core.geometry import BoolArray, FloatArray
from fbgraph.core.sensor_log import Stream
from fbgraph.front_end.levelled_signals import LevelledSignals
from fbgraph.readers.cleaning import LONG_GAP_S, saturated

Span = tuple[float, float]
_SHORTEST_STILL_S = 1.0
_QUIET_M_S2 = 0.15  # one sigma of |acc| over a second in a hand that holds still
_MOST_TOLD = 20
_MISSED_SAMPLES = 3.0
_UNITS = {"acc": ("m_s2", 1.0), "gyro": ("deg_s", float(np.degrees(1.0)))}


def streams_told(streams: Mapping[str, Stream], unscaled: Collection[str] = ()) -> dict[str, Any]:
    """Of each sensor that is there: samples, rate, gaps; its rail, if its unit is known."""
    return {
        name: _stream("" if name in unscaled else name, stream) for name, stream in streams.items() if len(stream) > 1
    }


def _stream(name: str, stream: Stream) -> dict[str, Any]:
    gaps_s = np.diff(stream.t_s)
    told: dict[str, Any] = {
        "samples": len(stream),
        "rate_hz": round(stream.rate_hz, 3),
        "mean_rate_hz": round((len(stream) - 1) / max(float(stream.t_s[-1] - stream.t_s[0]), 1e-9), 3),
        "start_s": round(float(stream.t_s[0]), 3) + 0.0,
        "end_s": round(float(stream.t_s[-1]), 3),
        "longest_gap_s": round(float(gaps_s.max()), 3),
        "gaps": [[round(edge, 3) for edge in span] for span in gaps(stream)[:_MOST_TOLD]],
        "gaps_count": len(gaps(stream)),
        "gaps_from_s": round(longest_regular_s(stream), 3),
    }
    if name in _UNITS:
        unit, scale = _UNITS[name]
        rail, count = saturated(name, stream.values)
        told[f"rail_{unit}"], told["samples_at_rail"] = (round(rail * scale, 3) if count else None), count
    return told


def longest_regular_s(stream: Stream) -> float:
    """From when on a sensor is missed: a second, or three of its samples if it is a slow one."""
    return max(LONG_GAP_S, _MISSED_SAMPLES / stream.rate_hz)


def gaps(stream: Stream) -> list[Span]:
    """Begin and end of each hole of more than ``longest_regular_s``, seconds since log start."""
    at = np.flatnonzero(np.diff(stream.t_s) > longest_regular_s(stream))
    return list(zip(stream.t_s[at].tolist(), stream.t_s[at + 1].tolist(), strict=True))


def still_spans(signals: LevelledSignals | None, acc: Stream | None) -> list[Span]:
    """When the device was still: as the front end says, without a gyroscope as the accelerometer alone shows it."""
    if signals is not None and len(signals):
        return _spans(signals.t_s, signals.still)
    if acc is None or len(acc) < 3:
        return []
    norm = np.linalg.norm(acc.values, axis=1)
    second = np.floor(acc.t_s).astype(np.int64)
    first = np.flatnonzero(np.diff(second, prepend=second[0] - 1))
    count = np.diff(np.append(first, len(norm)))
    mean = np.add.reduceat(norm, first) / count
    spread = np.sqrt(np.maximum(np.add.reduceat(norm**2, first) / count - mean**2, 0.0))
    return _spans(acc.t_s, np.repeat(spread < _QUIET_M_S2, count))


def _spans(t_s: FloatArray, inside: BoolArray) -> list[Span]:
    edges = np.flatnonzero(np.diff(np.concatenate(([False], inside, [False])).astype(np.int8)))
    spans = [(float(t_s[a]), float(t_s[b - 1])) for a, b in zip(edges[::2].tolist(), edges[1::2].tolist(), strict=True)]
    return [span for span in spans if span[1] - span[0] >= _SHORTEST_STILL_S]


def rest_told(spans: list[Span], gyro: Stream | None) -> dict[str, Any]:
    """Still phases, and what the gyroscope says while nothing turns."""
    told: dict[str, Any] = {
        "still": [[round(edge, 2) for edge in span] for span in spans[:_MOST_TOLD]],
        "still_count": len(spans),
        "still_total_s": round(sum(end_s - start_s for start_s, end_s in spans), 2),
        "gyro_bias_deg_s": None,
    }
    if gyro is not None and spans:
        rest = np.concatenate([gyro.between(*span).values for span in spans])
        if len(rest):
            told["gyro_bias_deg_s"] = [round(bias, 3) for bias in np.degrees(np.median(rest, axis=0)).tolist()]
    return told
