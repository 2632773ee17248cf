"""What ``fbgraph inspect`` prints: its report in lines of 80 columns, no number cut."""

from __future__ import annotations

import textwrap
from collections.abc import Iterator
from typing import Any

from fbgraph.core.safe_text import short_name

_WIDTH = 80
_SENSORS = {
    **{"acc": "accelerometer", "gyro": "gyroscope", "mag": "magnetometer", "pressure": "barometer"},
    **{"linear_acc": "acceleration without gravity", "gravity": "gravity"},
}
_MOST_SPANS = 4


def report_lines(report: dict[str, Any]) -> list[str]:
    """The report of ``inspection.inspect_log`` for people."""
    parts = (_log, _tables, _clocks, _physics, _sensors, _rest, _field, _worn, _smooth)
    return [line for part in parts for line in part(report)]


def _wrapped(text: str, indent: int = 2) -> list[str]:
    """A text in lines; only a name longer than a line makes one longer."""
    inner = " " * (indent + 2)
    return textwrap.wrap(
        text,
        _WIDTH,
        initial_indent=" " * indent,
        subsequent_indent=inner,
        break_long_words=False,
        break_on_hyphens=False,
    )


def _log(report: dict[str, Any]) -> Iterator[str]:
    log = report["log"]
    text = f"{short_name(log['name'])}: {log['format'] or 'cannot be read as a walk'}"
    if log["duration_s"] is not None:
        text += f", {log['duration_s']:.1f} s, preset {log['preset']}"
    for what in ("truth", "gnss"):
        text += f", {what}: {log[what]}" if log[what] else ""
    yield from _wrapped(text, 0)


def _tables(report: dict[str, Any]) -> Iterator[str]:
    for table in report["tables"]:
        yield ""
        yield from _wrapped(f"table {short_name(table['name'])}: {table['rows']} rows; {table['how']}", 0)
        for column in table["columns"]:
            if column["used"]:
                unit = f" in {column['unit']}" if column["unit"] else ""
                yield from _wrapped(f"{short_name(column['name'])}: {column['taken_for']}{unit} ({column['why']})")
        for column in table["columns"]:
            if not column["used"]:
                taken = "" if column["taken_for"] == "unknown" else f"{column['taken_for']}; "
                why = column.get("ignored_because", "")
                yield from _wrapped(f"ignored: {short_name(column['name'])} ({taken}{why})")
    for out in report["left_out"]:
        yield from _wrapped(f"left out: {short_name(out['source'])} ({out['why']})", 0)


def _clocks(report: dict[str, Any]) -> Iterator[str]:
    yield ""
    for clock in report["clocks"]:
        names = ", ".join(map(short_name, clock["columns"])) or "rows"
        text = f"clock of {short_name(clock['table'])}: {names}, {clock['kind']} ({clock['why']})"
        text += f", begins again at {clock['wraps_at']:.0f}" if clock["wraps_at"] else ""
        yield from _wrapped(f"{text}. {clock['note']}" if clock["note"] else text, 0)


def _physics(report: dict[str, Any]) -> Iterator[str]:
    physics = report["physics"]
    for name, told in physics.items():
        if name == "axes_told":
            if not told:
                yield from _wrapped("the device turned too little to tell whether axes are as named", 0)
            continue
        by = {"name": "as named", "physics": "by what it shows", "assumed": "assumed"}[told["by"]]
        axes = f", axes {' '.join(told['axes'])}" if told["axes"] and told["axes"] != ["x", "y", "z"] else ""
        sure = "sure" if told["sure"] else "not sure"
        text = f"{_SENSORS[name]}: {told['unit']}{axes}, {by}, {sure}"
        yield from _wrapped(f"{text}: {told['said']}" if told["said"] else text, 0)


def _sensors(report: dict[str, Any]) -> Iterator[str]:
    yield ""
    for name, told in report["sensors"].items():
        text = f"{_SENSORS[name]}: {told['samples']} samples at {told['rate_hz']:g} Hz"
        if abs(told["mean_rate_hz"] / max(told["rate_hz"], 1e-9) - 1.0) > 0.02:
            text += f" ({told['mean_rate_hz']:g} Hz with its gaps)"
        text += f", {told['start_s']:.2f} to {told['end_s']:.2f} s, longest gap {told['longest_gap_s']:g} s"
        if told["gaps_count"]:
            spans = _spans(told["gaps"], told["gaps_count"])
            text += f"; {told['gaps_count']} gaps of more than {told['gaps_from_s']:.2g} s: {spans}"
        for key, unit in (("rail_m_s2", "m/s²"), ("rail_deg_s", "°/s")):
            if told.get(key) is not None:
                text += f"; {told['samples_at_rail']} samples at its limit of {told[key]:g} {unit}"
        yield from _wrapped(text, 0)
    jumps = {why.replace("_", " "): count for why, count in report["clock_jumps"].items()}
    if jumps:
        yield from _wrapped("clock jumps: " + ", ".join(f"{count} {why}" for why, count in jumps.items()), 0)
    elif report["sensors"]:
        yield "clock jumps: none"


def _spans(spans: list[list[float]], count: int) -> str:
    told = ", ".join(f"{start_s:.1f} to {end_s:.1f} s" for start_s, end_s in spans[:_MOST_SPANS])
    return f"{told}, and {count - _MOST_SPANS} more" if count > _MOST_SPANS else told


def _rest(report: dict[str, Any]) -> Iterator[str]:
    rest = report["rest"]
    text = "still: never for a second"
    if rest["still_count"]:
        text = f"still for {rest['still_total_s']:.1f} s: {_spans(rest['still'], rest['still_count'])}"
    if rest["gyro_bias_deg_s"] is not None:
        text += f"; the gyroscope then shows {', '.join(f'{b:.3f}' for b in rest['gyro_bias_deg_s'])} °/s"
    yield from _wrapped(text, 0)


def _field(report: dict[str, Any]) -> Iterator[str]:
    field = report["field"]
    if field is None:
        yield "no magnetometer: nothing tells North"
        return
    low, high = field["strength_5_to_95_ut"]
    text = f"magnetic field: {field['strength_ut']:.1f} µT ({low:.1f} to {high:.1f})"
    text += "" if field["dip_deg"] is None else f", dip {field['dip_deg']:.1f}°"
    if field["hard_iron_level_ut"] is None:
        text += "; iron in the device: not told, it turned too little"
    else:
        iron = ", ".join(f"{value:.1f}" for value in field["hard_iron_level_ut"])
        text += f"; iron in the device, level part: {iron} µT"
    text += f"; {'' if field['is_earths'] else 'not '}Earth's: {field['why']}"
    yield from _wrapped(text, 0)


def _worn(report: dict[str, Any]) -> Iterator[str]:
    yield from _wrapped(f"worn: {report['worn']['how']} ({report['worn']['why']})", 0)


def _smooth(report: dict[str, Any]) -> Iterator[str]:
    told = report["smooth"]
    yield ""
    text = f"smooth would say: {told['verdict']}"
    if "distance_m" in told:
        text += f", {told['steps']} steps, {told['distance_m']:.1f} m"
    yield text
    for reason in told["reasons"][:3]:
        yield from _wrapped(f"- {reason}")
    for note in told.get("notes", []):
        yield from _wrapped(f"note: {note}")
    mend = {"refused": "next, once that is mended:", "withheld": "next, once that is mended, or with --force:"}
    yield mend.get(told["verdict"], "next:")
    yield f"  {report['next']}"
