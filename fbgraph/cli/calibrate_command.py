"""calibrate: a wearer and a device from walks of known length."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from fbgraph.cli.app import (
    ConfigOption,
    FormatOption,
    JsonOption,
    LayoutOption,
    MaxSizeOption,
    RateOption,
    SetOption,
    UseGnssOption,
    WorkersOption,
    app,
    workers_for,
)
from fbgraph.cli.printing import print_table, say, say_json

if TYPE_CHECKING:
    from fbgraph.calibration.calibrate import Calibration
    from fbgraph.calibration.wearer import WearerFit


@app.command(
    epilog="Examples: `fbgraph calibrate there_and_back.csv --distance 200 --out wearer.toml`, "
    "`fbgraph calibrate a.csv b.csv --truth a_truth.csv --truth b_truth.csv --out wearer.toml`, then "
    "`fbgraph smooth walk.csv --config wearer.toml`"
)
def calibrate(
    logs: Annotated[
        list[Path], typer.Argument(metavar="LOG…", help="Walks of one wearer with one device.", show_default=False)
    ],
    out: Annotated[
        Path | None, typer.Option("--out", metavar="FILE.toml", help="Write what --config takes there.")
    ] = None,
    distance: Annotated[
        list[float] | None,
        typer.Option(
            metavar="METRES",
            help="How far each log goes, from its first step to its last; one for all, or one a log. 100 m there and "
            "back: --distance 200",
        ),
    ] = None,
    truth: Annotated[
        list[Path] | None,
        typer.Option(metavar="FILE", help="Known places, one file a log, as smooth takes them; the log's own if none."),
    ] = None,
    anchors: Annotated[
        list[Path] | None, typer.Option(metavar="FILE", help="The same, where you call them anchors.")
    ] = None,
    use_gnss: UseGnssOption = "none",
    config: ConfigOption = None,
    set_: SetOption = None,
    format_: FormatOption = None,
    layout: LayoutOption = None,
    rate: RateOption = None,
    max_size: MaxSizeOption = None,
    workers: WorkersOption = None,
    as_json: JsonOption = False,
) -> None:
    """Fit the step length to a wearer, and find a device's iron and gyroscope scale, from walks of known length.

    As many coefficients are fitted as the walks tell, by least squares and drawn towards those of --config; the others
    keep their proportions. --config m5stickc fits the paper's α, β, γ. One known distance is enough for the scale.
    A fit that does hardly better on walks (of one walk, legs) left out is not used, which is said.
    """
    from fbgraph.calibration.calibrate_logs import calibrate as calibrate_logs
    from fbgraph.core.bounded import parse_size
    from fbgraph.run.folder import require_free

    if out is not None:
        require_free(out, "--out")
    found = calibrate_logs(
        logs,
        distance_m=distance or None,
        truth=truth or None,
        anchors=anchors or None,
        use_gnss=use_gnss,
        config=config,
        overrides=set_ or (),
        format_name=format_,
        max_size=None if max_size is None else parse_size(max_size),
        layout=layout,
        rate_hz=rate,
        workers=workers_for(len(logs), workers),
    )
    if out is not None:
        found.save(out)
    if as_json:
        say_json({**found.as_dict(), "out": None if out is None else str(out)})
        return
    _print(found)
    say(
        f"written to {out}; `fbgraph smooth LOG --config {out}` uses it" if out else "not written: --out FILE.toml does"
    )


def _print(found: Calibration) -> None:
    wearer = found.wearer
    walks, legs = (f"{n} {what}{'' if n == 1 else 's'}" for n, what in ((wearer.walks, "walk"), (wearer.legs, "leg")))
    say(f"{walks}, {legs} of known length: {wearer.walked_m:.1f} m, {wearer.steps} steps")
    told = [one.key for one in wearer.coefficients if one.fitted]
    what = f"scale, {', '.join(told)}" if told else "their scale only: these walks tell no more"
    say(f"fitted: {what}")
    say(f"steps are {wearer.scale:.3f} of what they were taken for (± {1.96 * wearer.scale_sigma:.3f}, 95 %)")
    rows = []
    for one in wearer.coefficients:
        if one.value == one.shipped == 0.0:
            continue
        how = "fitted" if one.fitted else "in proportion"
        rows.append([one.key, f"{one.value:.3f}", f"{one.low:.3f} to {one.high:.3f}", f"{one.shipped:.3f}", how])
    print_table(["step_length", "value", "95 %", "as it was", "how"], rows)
    say(_checked(wearer))
    if not wearer.better:
        say("not used: the step length stays as it was, for the fit does no better on what it had not seen")
    say(
        f"steps of {wearer.hz[0]:.2f} to {wearer.hz[1]:.2f} a second, surge {wearer.surge_m_s[0]:.2f} to "
        f"{wearer.surge_m_s[1]:.2f} m/s; walks outside that are told"
    )
    for text in (*found.device.notes, *(f"note: {text}" for text in found.notes)):
        say(text)


def _checked(wearer: WearerFit) -> str:
    """How the fit did on what it had not seen."""
    checked = wearer.cross_validation
    if checked is None:
        return "one length only: nothing to check it on"
    return (
        f"a {checked.left_out} left out at a time, {checked.count} of them: {100.0 * checked.shipped_rel:.1f} % off as "
        f"it was, {100.0 * checked.fitted_rel:.1f} % as fitted to the others (RMS of the lengths)"
    )
