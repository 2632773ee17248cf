"""Commands that compare runs with truth and with one another: evaluate, plot."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from fbgraph.cli.app import JsonOption, app
from fbgraph.cli.printing import complain, print_scores, say, say_json

RunsArgument = Annotated[list[Path], typer.Argument(metavar="RUN…", help="Run folders.", show_default=False)]
TruthsOption = Annotated[
    list[Path] | None,
    typer.Option(
        "--truth",
        metavar="FILE",
        help="Known places, in any form that `fbgraph smooth --truth` takes; one file for all runs, or one for each in "
        "their order; what each run was made with if absent.",
        show_default=False,
    ),
]


@app.command(epilog="Example: fbgraph evaluate runs/a runs/b --truth truth.csv --errors errors.csv")
def evaluate(
    runs: RunsArgument,
    truth: TruthsOption = None,
    errors: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE.csv", help="Write a row a checkpoint: where it is, where the estimate, how far apart."
        ),
    ] = None,
    as_json: JsonOption = False,
) -> None:
    """Score run folders against known places, in one table.

    Errors are horizontal. "aligned" is the RMSE after the best turn and shift, "turned" how far to the left of the
    truth the walk lies before it; "final %" is of the distance walked; CE50 to CE95 are circular errors, Q3 the third
    quartile, growth the slope of the error over time. JSON of one run is by estimator, of several by run and estimator.
    """
    from fbgraph.run.evaluation import write_errors
    from fbgraph.run.folder import require_free
    from fbgraph.run.named_runs import named_runs

    if errors is not None:
        require_free(errors, "--errors")
    compared = named_runs(runs, truth or (), complain)
    scores = {run.name: run.scores() for run in compared}
    if errors is not None:
        write_errors(errors, compared)
    if as_json:
        say_json(scores if len(runs) > 1 else scores[compared[0].name])
    elif len(runs) == 1:
        print_scores({str(compared[0].saved.summary["log"]["name"]): scores[compared[0].name]})
    else:
        print_scores(scores)
    if errors is not None and not as_json:
        say(f"written to {errors}")


@app.command(epilog="Example: fbgraph plot runs/a --out walk.pdf --width 3.5")
def plot(
    runs: RunsArgument,
    out: Annotated[Path, typer.Option(metavar="FILE.png|.pdf|.svg", help="The figure to write.", show_default=False)],
    truth: TruthsOption = None,
    estimator: Annotated[
        list[str] | None,
        typer.Option(
            metavar="smoothed|online|ekf|pdr",
            help="What to draw; repeatable. All of one run, the best of each of several, if absent.",
            show_default=False,
        ),
    ] = None,
    width: Annotated[
        float, typer.Option(metavar="INCHES", min=2.5, max=20.0, help="3.5 for a column, 7 for a page.")
    ] = 7.0,
) -> None:
    """Draw runs for a paper: map with ellipses and truth, errors, heading, altitude; several compared in one figure."""
    from fbgraph.plots.walk_figure import require_figure, write_figure
    from fbgraph.run.folder import require_free
    from fbgraph.run.named_runs import named_runs

    require_figure(out)
    require_free(out, "--out")
    write_figure(named_runs(runs, truth or (), complain, lost_is_unknown=True), out, estimator or (), width)
    say(f"written to {out}")
