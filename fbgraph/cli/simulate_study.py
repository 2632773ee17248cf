"""Commands that need no walk of yours: simulate, study, formats, config."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Annotated

import typer

from fbgraph.cli.app import (
    ConfigOption,
    JsonOption,
    MaxSizeOption,
    SetOption,
    app,
)
from fbgraph.cli.printing import print_table, say, say_document, say_json, study_progress_bar
from fbgraph.core.errors import ConfigError
from fbgraph.core.safe_text import for_json, short_name


@app.command(epilog="Example: `fbgraph simulate walk.csv --route eight --seed 3`")
def simulate(
    out: Annotated[Path, typer.Argument(metavar="OUT.csv", help="The M5StickC log to write.", show_default=False)],
    route: Annotated[
        str,
        typer.Option(
            metavar="NAME|FILE", help="obstacle, square, straight, eight, out-and-back, stairs, or x_m,y_m[,z_m] CSV."
        ),
    ] = "obstacle",
    seed: Annotated[int, typer.Option(help="Same seed, same walk.")] = 0,
    laps: Annotated[int, typer.Option(help="Walk the route so often.")] = 1,
    scale: Annotated[float, typer.Option(help="Stretch the route.")] = 1.0,
    duration_s: Annotated[
        float | None, typer.Option("--duration", metavar="SECONDS", help="Repeat the route for about this long.")
    ] = None,
    noise: Annotated[float, typer.Option(help="Sensor errors: 1 as the data sheets say, 0 perfect.")] = 1.0,
    anomalies: Annotated[float, typer.Option(help="Strength of the iron beside the route.")] = 1.0,
    variation: Annotated[float, typer.Option(help="Irregularity of the gait; 0 is a metronome.")] = 1.0,
    shake_s: Annotated[float, typer.Option("--shake", metavar="SECONDS", help="Shake and turn before the walk.")] = 0.0,
    as_json: JsonOption = False,
) -> None:
    """Write a simulated M5StickC log, and its exact truth beside it as OUT_truth.csv."""
    from fbgraph.simulator.files import simulate_files
    from fbgraph.simulator.gait import Walker
    from fbgraph.simulator.routes import load_route
    from fbgraph.simulator.simulate_options import SimulateOptions

    walker = Walker(gait_variation=variation, shake_s=shake_s)
    options = SimulateOptions(walker=walker, noise=noise, anomalies=anomalies, duration_s=duration_s)
    written = simulate_files(out, load_route(route, scale, laps), options, seed)
    if as_json:
        say_json(written)
        return
    for key, value in written.items():
        say(f"{key}: {value}")


@app.command(epilog="Example: `fbgraph formats`")
def formats(as_json: JsonOption = False) -> None:
    """List the log formats that can be read, with an example of each."""
    from fbgraph.readers import FORMATS, log_format

    known = [log_format(name) for name in FORMATS]
    if as_json:
        say_json([{"name": f.name, "description": f.description, "example": f.example} for f in known])
        return
    for one in known:
        say(f"{one.name}: {one.description}")
        lines = "".join(f"    {line}\n" for line in one.example.strip().splitlines())
        say_document(f"{lines}\n", for_reading=True)


@app.command(epilog="Examples: `fbgraph study simulated --trials 6`, `fbgraph study trials.zip --mapping mine.toml`")
def study(
    dataset: Annotated[
        str,
        typer.Argument(
            metavar="DATASET|simulated",
            help="A CSV a trial, a folder or a zip of them; or simulated.",
            show_default=False,
        ),
    ],
    out: Annotated[
        Path | None, typer.Option("--out", metavar="DIR", help="Study folder; studies/<name> if absent.")
    ] = None,
    seed: Annotated[int | None, typer.Option(help="Of simulated trials; 1 if absent.", show_default=False)] = None,
    trials: Annotated[int | None, typer.Option(min=1, help="The first so many trials; all, or 36.")] = None,
    mapping: Annotated[
        Path | None,
        typer.Option(metavar="FILE", help="What the columns are called, as in configs/forestback.toml."),
    ] = None,
    max_size: MaxSizeOption = None,
    config: ConfigOption = None,
    set_: SetOption = None,
    as_json: JsonOption = False,
) -> None:
    """Reproduce the ForestBack paper's evaluation, and ours beside it: tables, figures, report."""
    import shlex

    from fbgraph.core.bounded import parse_size
    from fbgraph.core.config import STUDY_TABLE, load_config
    from fbgraph.study.column_names import load_layout
    from fbgraph.study.run_study import SIMULATED, study_files

    simulated = dataset == SIMULATED
    if seed is not None and not simulated:
        raise ConfigError("--seed is for simulated trials; a data set has none")
    source = config or "forestback"
    of_layout = [text for text in set_ or () if text.startswith(f"{STUDY_TABLE}.")]
    effective = load_config(source, [text for text in set_ or () if text not in of_layout])
    layout = load_layout(source, of_layout, mapping)
    seed = 1 if seed is None else seed
    most = None if max_size is None else parse_size(max_size)
    folder = out or Path("studies") / (f"simulated-{seed}" if simulated else Path(dataset).name.partition(".")[0])
    command = shlex.join(["fbgraph", *sys.argv[1:]])
    with study_progress_bar() as progress:
        result = study_files(dataset, folder, effective, layout, seed, trials, command, progress, most)
    from fbgraph.study.report import headline, summary, table  # heavy, and by now imported

    if as_json:
        say_json({"out": str(folder), **summary(result)})
        return
    say(headline(result))
    head, *rows = table(result)
    print_table(head, rows)
    for name, reason in result.skipped:
        say(f"not used: {short_name(name)}: {reason}")
    for text in result.notices:
        say(f"note: {text}")
    say(f"written to {folder}")


@app.command(epilog="Example: `fbgraph config --config phone --set steps.min_run=5`")
def config(config: ConfigOption = None, set_: SetOption = None, as_json: JsonOption = False) -> None:
    """Print the effective configuration as TOML."""
    from fbgraph.core.config import dump_toml, load_config

    effective = load_config(config, set_ or ())
    if as_json:
        say_document(for_json(effective.model_dump_json(indent=2)) + "\n", for_reading=False)
    else:
        say_document(dump_toml(effective), for_reading=True)
