"""A way in words and tables: what a lost walker reads, JSON, CSV."""

from __future__ import annotations

import csv
import io
import json
import math
from typing import Any, Literal

from fbgraph.core.geometry import heading_deg
from fbgraph.core.safe_text import for_csv, for_json, for_terminal, short_name
from fbgraph.way_back.legs import Climb, Directions, Leg, surely_climbs
from fbgraph.way_back.shorten import left_out_text

Units = Literal["metric", "steps"]

_WINDS = ("N", "NE", "E", "SE", "S", "SW", "W", "NW")
_THERE_M = 2.0  # who is nearer to the start than this is there
_NEAR_STEPS = 1.5  # a landmark within so many steps of a turn is at the turn
_CSV_COLUMNS = (
    *("leg", "instruction", "turn_deg", "heading_deg", "length_m", "steps", "rise_m", "remaining_m"),
    *("sigma_along_m", "sigma_across_m", "landmarks", "end_x_m", "end_y_m", "end_z_m"),
)


def heading_text(yaw_rad: float) -> str:
    """``210° SW`` of a yaw counter-clockwise from East."""
    heading = round(heading_deg(yaw_rad)) % 360
    return f"{heading:03d}° {_WINDS[round(heading / 45.0) % 8]}"


def turn_text(turn_rad: float) -> str:
    """``turn left 85°``, to the nearest five degrees; positive is left."""
    angle = 5 * round(abs(math.degrees(turn_rad)) / 5.0)
    if angle >= 160:
        return "turn around"
    verb = "bear" if angle < 45 else "turn sharp" if angle > 120 else "turn"
    return f"{verb} {'left' if turn_rad > 0 else 'right'} {angle}°"


def distance_text(length_m: float, pace_m: float, units: Units = "metric") -> str:
    """``23 m (34 steps)``, or ``34 steps (23 m)``."""
    count = round(length_m / pace_m)
    steps, metres = f"{count} step{'' if count == 1 else 's'}", _metres(length_m)
    return f"{metres} ({steps})" if units == "metric" else f"{steps} ({metres})"


def instruction(
    leg: Leg,
    turn_rad: float | None,
    pace_m: float,
    units: Units = "metric",
    *,
    back: bool = True,
    compass: bool = True,
    at: str = "",
) -> str:
    """What to do on one leg, in a sentence.

    Args:
        leg: as it is walked.
        turn_rad: the turn before it, positive to the left; None on the first leg.
        pace_m: length of a step.
        units: whether metres or steps come first.
        back: whether the walker comes from where the first leg leads.
        compass: whether to name headings.
        at: landmarks where the leg begins, see ``landmarks_at``.
    """
    heading, far = heading_text(leg.yaw_rad), distance_text(leg.length_m, pace_m, units)
    if turn_rad is not None:
        text = f"{turn_text(turn_rad)}, then {far}{f' heading {heading}' if compass else ''}"
    elif compass:
        text = f"{'turn around: ' if back else ''}face {heading}, then walk {far}"
    else:
        text = f"{'turn around, then ' if back else ''}walk {far}"
    text = f"at {at}, {text}" if at else text
    parts = [text[0].upper() + text[1:], *(_climb_text(climb, leg, pace_m, units) for climb in _climbs(leg))]
    near_m = _NEAR_STEPS * pace_m
    for mark in leg.landmarks:
        if mark.after_m > near_m and mark.before_m > near_m:
            parts.append(f"past {_quoted(mark.label)} after {distance_text(mark.after_m, pace_m, units)}")
    return ", ".join(parts) + "."


def landmarks_at(way: Directions, corner: int) -> str:
    """The landmarks at the beginning of a leg, or with ``corner == len(way.legs)`` at the end, quoted; or nothing."""
    near_m = _NEAR_STEPS * way.pace_m
    before = way.legs[corner - 1].landmarks if corner > 0 else ()
    after = way.legs[corner].landmarks if corner < len(way.legs) else ()
    labels = [mark.label for mark in before if mark.before_m <= near_m and mark.before_m < mark.after_m]
    labels += [mark.label for mark in after if mark.after_m <= near_m and mark.after_m <= mark.before_m]
    return ", ".join(_quoted(label) for label in dict.fromkeys(labels))


def instructions(way: Directions, units: Units = "metric") -> list[str]:
    """A sentence a leg, and the arrival."""
    kept: dict[str, Any] = {"back": way.back, "compass": way.compass}
    sentences = [
        instruction(leg, way.turn_rad(i) if i > 0 else None, way.pace_m, units, at=landmarks_at(way, i), **kept)
        for i, leg in enumerate(way.legs)
    ]
    return [*sentences, arrival_text(way)]


def arrival_text(way: Directions) -> str:
    """The last sentence."""
    at = landmarks_at(way, len(way.legs))
    return f"You are {'back at the start' if way.back else 'at the end of the walk'}{f', at {at}' if at else ''}."


def as_text(way: Directions, units: Units = "metric") -> str:
    """For reading: a numbered instruction a leg, with what is left after it and how far to trust it."""
    turns = len(way.legs) - 1
    name = short_name(way.name)
    lines = [
        f"{'Way back' if way.back else 'Way'} of {name}: {distance_text(way.length_m, way.pace_m, units)}, "
        f"{turns} turn{'' if turns == 1 else 's'}. A step is {way.pace_m:.2f} m."
    ]
    if way.caution:
        lines = [*(for_terminal(text) for text in way.caution), "", *lines]
    lines += left_out_text(way.left_out)
    apart_m = math.dist(way.points_m[0][:2], way.points_m[-1][:2])
    higher_m = way.points_m[-1][2] - way.points_m[0][2]
    level = not surely_climbs(higher_m, math.hypot(*(leg.sigma_rise_m or 0.0 for leg in way.legs)))
    if way.back and level and apart_m < max(2.0 * (way.sigma_m or 0.0), _THERE_M):
        lines += ["", f"The walk ended {_metres(apart_m)} from its start: this is all of it once more, backwards."]
    *sentences, arrival = instructions(way, units)
    for i, (leg, sentence) in enumerate(zip(way.legs, sentences, strict=True)):
        lines += ["", f"{i + 1:3d}. {sentence}"]
        notes = [] if i == turns else [f"{distance_text(way.remaining_m(i), way.pace_m, units)} left."]
        if leg.sigma_along_m is not None and leg.sigma_across_m is not None:
            notes.append(f"This leg: ±{leg.sigma_along_m:.1f} m in length, ±{leg.sigma_across_m:.1f} m sideways.")
        lines += [f"     {' '.join(notes)}"] if notes else []
    if way.sigma_m is not None:
        arrival += f" If you do not see it, look within {max(2.0 * way.sigma_m, 1.0):.0f} m."
    return "\n".join([*lines, "", f"{len(way.legs) + 1:3d}. {arrival}"]) + "\n"


def as_json(way: Directions, units: Units = "metric") -> str:
    """Everything about the way; angles in degrees, ``turn_deg`` positive to the left, ``end_m`` in the world frame."""
    *_, arrival = instructions(way, units)
    return for_json(
        json.dumps(
            {
                "name": way.name,
                "back": way.back,
                "length_m": round(way.length_m, 3),
                "pace_m": round(way.pace_m, 3),
                "steps": round(way.length_m / way.pace_m),
                "sigma_m": _rounded(way.sigma_m),
                "start_m": [_rounded(value) for value in way.legs[0].points_m[0]],
                "legs": leg_rows(way, units),
                "left_out": [
                    {
                        "after_m": round(one.after_m, 3),
                        "length_m": round(one.length_m, 3),
                        "apart_m": round(one.apart_m, 3),
                        "sigma_m": _rounded(one.sigma_m),
                        "sure": _rounded(one.sure),
                    }
                    for one in way.left_out
                ],
                "arrival": arrival,
                "integrity": way.integrity.as_dict(),
            },
            indent=2,
            ensure_ascii=False,
        )
        + "\n"
    )


def as_csv(way: Directions, units: Units = "metric") -> str:
    """One row a leg; several landmarks in one cell, separated by ``; ``."""
    out = io.StringIO()
    table = csv.DictWriter(out, _CSV_COLUMNS, extrasaction="ignore", lineterminator="\n")
    table.writeheader()
    for row in leg_rows(way, units):
        marks = for_csv("; ".join(f"{mark['label']} after {mark['after_m']:.1f} m" for mark in row["landmarks"]))
        end = dict(zip(("end_x_m", "end_y_m", "end_z_m"), row["end_m"], strict=True))
        table.writerow({**row, "landmarks": marks, **end})
    return out.getvalue()


def leg_rows(way: Directions, units: Units = "metric") -> list[dict[str, Any]]:
    """What JSON, CSV and maps say of each leg."""
    return [
        {
            "leg": i + 1,
            "instruction": sentence,
            "turn_deg": round(math.degrees(way.turn_rad(i)), 1) if i > 0 else None,
            "heading_deg": round(heading_deg(leg.yaw_rad), 1) % 360.0 if way.compass else None,
            "length_m": round(leg.length_m, 3),
            "steps": round(leg.length_m / way.pace_m),
            "rise_m": _rounded(leg.rise_m),
            "climbs": [
                {
                    "after_m": _rounded(climb.after_m),
                    "before_m": _rounded(climb.before_m),
                    "rise_m": _rounded(climb.rise_m),
                    "lift": climb.ride,
                }
                for climb in leg.climbs
            ],
            "remaining_m": round(way.remaining_m(i), 3),
            "sigma_along_m": _rounded(leg.sigma_along_m),
            "sigma_across_m": _rounded(leg.sigma_across_m),
            "landmarks": [{"label": mark.label, "after_m": round(mark.after_m, 3)} for mark in leg.landmarks],
            "end_m": [_rounded(value) for value in leg.points_m[-1]],
        }
        for i, (leg, sentence) in enumerate(zip(way.legs, instructions(way, units)[:-1], strict=True))
    ]


def _climbs(leg: Leg) -> tuple[Climb, ...]:
    """Those of a leg, or its whole rise if that is not in any one place."""
    if leg.climbs or not surely_climbs(leg.rise_m, leg.sigma_rise_m):
        return leg.climbs
    return (Climb(0.0, 0.0, leg.rise_m),)


def _climb_text(climb: Climb, leg: Leg, pace_m: float, units: Units) -> str:
    text = f"{abs(climb.rise_m):.0f} m {'up' if climb.rise_m > 0 else 'down'}"
    if climb.ride:
        return f"{_ride_where(climb, leg, pace_m, units)} take the lift (or escalator) {text}"
    if climb.after_m + climb.before_m < 0.4 * leg.length_m:
        return text  # most of the leg
    near_m = _NEAR_STEPS * pace_m
    steps = units == "steps"
    begin, end = (
        f"{round(at_m / pace_m)}" if steps else _metres(at_m) for at_m in (climb.after_m, leg.length_m - climb.before_m)
    )
    over = distance_text(leg.length_m - climb.after_m - climb.before_m, pace_m, units)
    if climb.after_m < near_m:
        return f"{text} on the first {over}"
    if climb.before_m < near_m:
        return f"{text} on the last {over}"
    return f"{text} between {'steps ' if steps else ''}{begin} and {end}"


def _ride_where(climb: Climb, leg: Leg, pace_m: float, units: Units) -> str:
    """Where on a leg a lift is taken; the step during which it was counts to neither side."""
    near_m = _NEAR_STEPS * pace_m
    if climb.after_m < near_m and climb.after_m <= climb.before_m:
        return "first"
    if climb.before_m < near_m:
        return "at its end"
    return f"after {distance_text(climb.after_m, pace_m, units)}"


def _quoted(label: str) -> str:
    """A landmark in a sentence."""
    return f"“{short_name(label)}”"


def _metres(length_m: float) -> str:
    return f"{length_m:.0f} m" if length_m >= 9.95 else f"{length_m:.1f} m"


def _rounded(value: float | None) -> float | None:
    return None if value is None else round(value, 3) + 0.0  # no -0.0
