"""Commands that learn from many walks: learn-building."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from fbgraph.cli.app import ConfigOption, JsonOption, OriginOption, SetOption, WorkersOption, app, workers_for
from fbgraph.cli.printing import say, say_json, study_progress_bar

if TYPE_CHECKING:
    from fbgraph.learning import LearnedBuilding


@app.command(
    "learn-building",
    epilog="Example: `fbgraph learn-building walks/*.csv --out mall.toml`, then `fbgraph smooth walk.csv --building "
    "mall.toml`",
)
def learn_building(
    logs: Annotated[
        list[Path],
        typer.Argument(metavar="LOG…", help="Logs of ten walks or more in one building.", show_default=False),
    ],
    out: Annotated[Path, typer.Option("--out", metavar="FILE.toml", help="Where to write what was found.")],
    config: ConfigOption = None,
    set_: SetOption = None,
    origin: OriginOption = None,
    workers: WorkersOption = None,
    as_json: JsonOption = False,
) -> None:
    """Learn which way a building's corridors run, and its magnetic field, from walks without truth.

    The axis is known up to right angles. Where walks show none, as in a park, that is said and nothing is written.
    """
    from fbgraph.core.building_files import write_building
    from fbgraph.core.georeference import parse_origin
    from fbgraph.learning import learn_building as learn
    from fbgraph.run.folder import require_free

    require_free(out, "--out")
    where = None if origin is None else parse_origin(origin)
    there = None if where is None else (where.lat_deg, where.lon_deg)
    with study_progress_bar() as progress:
        processes = workers_for(len(logs), workers)
        found = learn(logs, config=config, overrides=set_ or (), origin=there, workers=processes, progress=progress)
    write_building(found.building, out)
    if as_json:
        say_json(_as_dict(found, out))
        return
    for line in _lines(found):
        say(line)
    for note in found.notes:
        say(f"note: {note}")
    say(f"written to {out}")


def _as_dict(found: LearnedBuilding, out: Path) -> dict[str, Any]:
    return {
        "out": str(out),
        **found.building.model_dump(mode="json"),
        "log_odds": round(found.log_odds, 3),
        "logs": list(found.walks),
        "notes": list(found.notes),
    }


def _lines(found: LearnedBuilding) -> list[str]:
    """What was found, for people."""
    axis, field = found.building.axis, found.building.field
    lines = [
        f"corridors run at {axis.heading_deg:.1f} ± {2.0 * axis.sigma_deg:.1f}° (2σ) clockwise from {axis.north} North "
        f"and at right angles to that, by {found.building.walks} walks"
    ]
    if field is not None:
        lines.append(
            f"the field is {field.strength_ut:.1f} ± {2.0 * field.sigma_strength_ut:.1f} µT strong and dips by "
            f"{field.dip_deg:.0f} ± {2.0 * field.sigma_dip_deg:.0f}° (2σ of its walks)"
        )
    return lines
