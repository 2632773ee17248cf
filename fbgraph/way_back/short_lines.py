"""The next thing to do in one short line, for the small screen of the device that is worn."""

from __future__ import annotations

from fbgraph.way_back.records import ReturnUpdate

ARROWS = {"^": "ahead", "<": "left", ">": "right", "v": "turn around", "o": "arrived", "?": "off the route"}
"""What the first character of a line stands for."""


def short_line(update: ReturnUpdate) -> str:
    """``ARROW,NEXT_M,LEFT_M,TEXT`` of a step: ``<,12,134,turn left 85 in 12 m``; nothing if nothing is to be said.

    NEXT_M is the distance to what is to be done next, LEFT_M to the start, both in whole metres; TEXT is ASCII, and
    begins with ``unsure:`` while the position is doubtful.
    """
    if not update.instruction:
        return ""
    words = update.instruction
    if unsure := words.startswith("position doubtful"):
        words = words.rpartition("; ")[2]
    next_m = update.remaining_m if update.next_turn_m is None else update.next_turn_m
    if update.off_route:
        arrow, next_m = "?", abs(update.cross_track_m)
    elif update.arrived:
        arrow, next_m = "o", 0.0
    elif words.startswith("turn around"):
        arrow = "v"
    elif words.startswith("straight on") or update.next_turn_rad is None:
        arrow = "^"
    else:
        arrow = "<" if update.next_turn_rad > 0 else ">"
    text = words.replace("°", "").encode("ascii", "ignore").decode()
    return f"{arrow},{next_m:.0f},{update.remaining_m:.0f},{'unsure: ' if unsure else ''}{text}"
