"""What a study leaves behind: tables (CSV, Markdown, LaTeX), summary.json, figures, recording and report.html."""

from __future__ import annotations

import base64
import csv
import json
import math
import time
from collections.abc import Callable
from dataclasses import asdict, fields
from importlib.metadata import version
from importlib.resources import files
from pathlib import Path
from typing import Any

from fbgraph import __version__
from fbgraph.core.config import dump_toml
from fbgraph.core.safe_text import for_csv, for_latex, for_markdown, for_terminal, in_template, visible
from fbgraph.study.column_names import dump_layout
from fbgraph.study.comparison import CONFIDENCE, RESAMPLES, Overall, Paired
from fbgraph.study.figures import draw
from fbgraph.study.protocol import LABELS, MATCH_S, MIN_TURN_RAD, TURN_S, StudyResult
from fbgraph.study.study_recording import write_study_recording

_PAPER = {  # section Overall Quantitative Performance
    "pdr": {"rmse_m": 1.129, "final_m": 1.781},
    "forestback": {"rmse_m": 0.965, "final_m": 1.388, "improvement_percent": 15.76, "turn_consistency_percent": 99.90}
    | {"current_ma": 60.31},
}
_MOST_REMARK = 300
_PACKAGES = ("gtsam", "numpy", "scipy", "vqf", "pandas", "matplotlib", "rerun-sdk")
_ROWS: tuple[tuple[str, Callable[[Overall], str]], ...] = (
    ("RMSE (m)", lambda o: f"{o.rmse_m:.3f}"),
    (f"  {CONFIDENCE:.0%} interval", lambda o: f"{o.rmse_low_m:.2f}–{o.rmse_high_m:.2f}"),
    ("  SD over trials", lambda o: f"{o.rmse_sd_m:.3f}"),
    ("  fitted without the trial", lambda o: f"{o.held_out_rmse_m:.3f}"),
    ("Mean error (m)", lambda o: f"{o.mean_m:.3f}"),
    ("Maximum error (m)", lambda o: f"{o.max_m:.3f}"),
    ("Final error (m)", lambda o: f"{o.final_m:.3f}"),
    ("RMSE improvement (%), mean of trials", lambda o: f"{o.improvement_percent:.2f}"),
    ("RMSE improvement (%), of the means", lambda o: f"{o.improvement_of_means_percent:.2f}"),
    ("Heading error, RMS (°)", lambda o: f"{o.heading_rms_deg:.1f}"),
    ("Turn consistency (%)", lambda o: f"{o.turn_consistency_percent:.2f}"),
    ("  precision (%)", lambda o: f"{100 * o.turn_precision:.2f}"),
    ("  recall (%)", lambda o: f"{100 * o.turn_recall:.2f}"),
    ("  time off, mean (s)", lambda o: f"{o.turn_apart_s:.2f}"),
)


def write_report(
    result: StudyResult, folder: Path, command: str, began_s: float, progress: Callable[[str, float], None]
) -> None:
    """Write everything into an existing folder.

    Args:
        result: the study.
        folder: where.
        command: what was typed.
        began_s: when, on ``time.perf_counter``'s clock.
        progress: told each stage.
    """
    progress("figures", 0.0)
    pictures = draw(result)
    (folder / "figures").mkdir()
    for name, (png, _) in pictures.items():
        (folder / "figures" / f"{name}.png").write_bytes(png)
    progress("tables", 0.0)
    (folder / "table.md").write_text(table_markdown(result), "utf-8")
    (folder / "table.tex").write_text(table_latex(result), "utf-8")
    _write_table_csv(result, folder / "table.csv")
    _write_trials_csv(result, folder / "trials.csv")
    remark = f"# {visible(result.simulated)}\n" if result.simulated else ""
    (folder / "config.toml").write_text(remark + _configuration(result), "utf-8")
    (folder / "summary.json").write_text(json.dumps(summary(result), indent=2, allow_nan=False) + "\n", "utf-8")
    progress("recording", 0.0)
    images = {name: png for name, (png, _) in pictures.items()}
    write_study_recording(
        result, images, f"{for_markdown(headline(result))}\n\n{table_markdown(result)}", folder / "study.rrd"
    )
    progress("report", 0.0)
    seconds = time.perf_counter() - began_s
    (folder / "report.html").write_text(_html(result, pictures, command, seconds), "utf-8")


def summary(result: StudyResult) -> dict[str, Any]:
    """What ``summary.json`` holds; null where a number is not known. Equal trials give an equal summary."""
    content = {
        "fbgraph": __version__,
        "source": result.source,
        "simulated": result.simulated or None,
        "trials": len(result.trials),
        "samples": sum(trial.trial.rows for trial in result.trials),
        "parameters": asdict(result.model),
        "parameters_held_out": [asdict(model) for model in result.held_out_models],
        "overall": {name: asdict(overall) for name, overall in result.comparison.overall.items()},
        "paired": [asdict(pair) for pair in result.comparison.paired],
        "current": None if result.comparison.current is None else asdict(result.comparison.current),
        "by_trial": {
            trial.trial.name: {name: _trial_row(result, index, name) for name in result.methods}
            for index, trial in enumerate(result.trials)
        },
        "paper": _PAPER,
        "skipped": [{"name": name, "reason": reason} for name, reason in result.skipped],
        "notices": list(result.notices),
        "versions": {name: version(name) for name in _PACKAGES},
    }
    return dict(_finite(content))


def _finite(value: Any) -> Any:
    """JSON knows no nan."""
    if isinstance(value, dict):
        return {key: _finite(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [_finite(item) for item in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value


def _trial_row(result: StudyResult, index: int, name: str) -> dict[str, float]:
    trial = result.trials[index]
    method = trial.methods[name]
    return {
        "rmse_m": method.rmse_m,
        "mean_m": method.mean_m,
        "max_m": method.max_m,
        "final_m": method.final_m,
        "improvement_percent": 100.0 * (1.0 - method.rmse_m / trial.methods["pdr"].rmse_m),
        "held_out_rmse_m": trial.held_out_rmse_m.get(name, math.nan),
        "turns_matched": method.turns.matched,
        "turns_missed": method.turns.missed,
        "turns_false": method.turns.false,
    }


def headline(result: StudyResult) -> str:
    """The result in a sentence or two; first of all whether it is simulated."""
    overall = result.comparison.overall
    said = f"SIMULATED, nobody walked ({_how(result)}). " if result.simulated else ""
    best = overall["smoothed"]
    return (
        f"{said}{len(result.trials)} trials: mean RMSE {overall['pdr'].rmse_m:.3f} m by plain PDR, "
        f"{overall['ekf'].rmse_m:.3f} m by the ForestBack EKF, {overall['online'].rmse_m:.3f} m by iSAM2 online, "
        f"{best.rmse_m:.3f} m by the smoother ({best.rmse_m / overall['ekf'].rmse_m:.2f} times the EKF's)."
    )


def _how(result: StudyResult) -> str:
    return for_terminal(result.simulated.removeprefix("simulated "), _MOST_REMARK)


def _caption(result: StudyResult) -> str:
    said = f"Simulated trials, not a measurement ({_how(result)}). " if result.simulated else ""
    return f"{said}Overall performance, means over {len(result.trials)} trials."


def table(result: StudyResult) -> list[list[str]]:
    """The paper's table with all methods: rows of text, the first the head."""
    overall = result.comparison.overall
    rows = [["Metric", *(LABELS[name] for name in overall)]]
    rows += [[label, *(_plain(show(o)) for o in overall.values())] for label, show in _ROWS]
    current = result.comparison.current
    whose = "logged_forestback" if "logged_forestback" in overall else "ekf"  # one device drew it, whatever it computed
    shown = {whose: "–" if current is None else f"{current.mean_ma:.2f}"}
    rows.append(["Current (mA)", *(shown.get(name, "–") for name in overall)])
    return rows


def _plain(text: str) -> str:
    return "–" if "nan" in text else text


def table_markdown(result: StudyResult) -> str:
    """For a README."""
    head, *rows = table(result)
    lines = [f"| {' | '.join(head)} |", f"|---{'|---:' * (len(head) - 1)}|"]
    lines += [f"| {' | '.join(row)} |" for row in rows]
    return f"{for_markdown(_caption(result))}\n\n" + "\n".join(lines).replace("|   ", "| … ") + "\n"


def table_latex(result: StudyResult) -> str:
    """For a paper; needs no package."""
    head, *rows = table(result)

    def line(cells: list[str], bold: bool = False) -> str:
        safe = [for_latex(cell) for cell in cells]
        safe[0] = r"\quad " + safe[0].strip() if safe[0].startswith("  ") else safe[0]
        return " & ".join(rf"\textbf{{{cell}}}" if bold else cell for cell in safe) + r" \\"

    body = "\n".join(line(row) for row in rows)
    caption = for_latex(_caption(result))
    return (
        f"\\begin{{table}}[t]\n\\centering\n\\caption{{{caption}}}\n\\small\n\\setlength{{\\tabcolsep}}{{3pt}}\n"
        f"\\begin{{tabular}}{{l{'c' * (len(head) - 1)}}}\n\\hline\n{line(head, bold=True)}\n\\hline\n{body}\n\\hline\n"
        "\\end{tabular}\n\\end{table}\n"
    )


def _write_table_csv(result: StudyResult, path: Path) -> None:
    with open(path, "w", encoding="utf-8", newline="") as out:
        rows = csv.writer(out, lineterminator="\n")
        rows.writerow(["method", "simulated", "trials", *(f.name for f in fields(Overall)), "current_ma"])
        current = result.comparison.current
        drawn_ma = None if current is None else current.mean_ma
        for name, overall in result.comparison.overall.items():
            numbers = [_cell(value) for value in asdict(overall).values()]
            rows.writerow([name, int(bool(result.simulated)), len(result.trials), *numbers, _cell(drawn_ma)])


def _write_trials_csv(result: StudyResult, path: Path) -> None:
    with open(path, "w", encoding="utf-8", newline="") as out:
        rows = csv.writer(out, lineterminator="\n")
        head = list(_trial_row(result, 0, "pdr"))
        rows.writerow(["trial", "simulated", "samples", "duration_s", "distance_m", "steps", "method", *head])
        for index, trial in enumerate(result.trials):
            truth = trial.trial.truth
            common = [for_csv(trial.trial.name), int(bool(result.simulated)), trial.trial.rows]
            common += [_cell(float(truth.t_s[-1] - truth.t_s[0])), _cell(float(truth.distance_m[-1])), trial.steps]
            for name in result.methods:
                rows.writerow([*common, name, *(_cell(v) for v in _trial_row(result, index, name).values())])


def _cell(value: float | int | None) -> str:
    if value is None or (isinstance(value, float) and math.isnan(value)):
        return ""
    return str(value) if isinstance(value, int) else f"{value:.6f}"


def _probability(p: float) -> str:
    return "–" if math.isnan(p) else "< 0.0001" if p < 1e-4 else f"{p:.4f}"


def _pair_row(pair: Paired) -> list[str]:
    return [
        f"{LABELS[pair.better]} – {LABELS[pair.worse]}",
        f"{pair.ratio:.3f}",
        f"{pair.difference_m:+.3f}",
        _plain(f"{pair.low_m:+.3f} … {pair.high_m:+.3f}"),
        f"{pair.wins} / {pair.trials}",
        _probability(pair.wilcoxon_p),
        _probability(pair.t_p),
    ]


def _configuration(result: StudyResult) -> str:
    """What ``--config`` takes back: everything that decided this study."""
    return f"{dump_toml(result.config)}\n{dump_layout(result.layout)}"


def _parameters(result: StudyResult) -> list[list[str]]:
    rows = []
    names = (("λ", "lambda_sigma", ""), ("L0", "constant_m", " m"), ("α", "alpha_m", " m"), ("β", "beta_m_s", " m/Hz"))
    for symbol, name, unit in (*names, ("γ", "gamma_m", " m")):
        value = getattr(result.model, name)
        held_out = [getattr(model, name) for model in result.held_out_models]
        spread = f"{min(held_out):.3f} … {max(held_out):.3f}" if held_out else "–"
        kept = "as configured: these trials cannot tell" if name in result.model.kept else ""
        rows.append([symbol, f"{value:.3f}{unit}", spread, kept])
    return rows


def _html(result: StudyResult, pictures: dict[str, tuple[bytes, str]], command: str, seconds: float) -> str:
    import jinja2

    template = jinja2.Environment(
        autoescape=True, trim_blocks=True, lstrip_blocks=True, finalize=in_template
    ).from_string((files("fbgraph.study") / "report.html.j2").read_text("utf-8"))
    heads = ["Difference", "ratio", "mean (m)", f"{CONFIDENCE:.0%} interval (m)", "better in", "Wilcoxon p", "t test p"]
    shown = result.methods
    return template.render(
        result=result,
        headline=headline(result),
        table=table(result),
        pairs=[heads, *(_pair_row(pair) for pair in result.comparison.paired)],
        parameters=_parameters(result),
        trials=[
            ["Trial", "steps", *(LABELS[name] for name in shown)],
            *(
                [trial.trial.name, str(trial.steps), *(f"{trial.methods[name].rmse_m:.2f}" for name in shown)]
                for trial in result.trials
            ),
        ],
        pictures=[(name, base64.b64encode(png).decode("ascii"), caption) for name, (png, caption) in pictures.items()],
        logged=any(name.startswith("logged") for name in shown),
        resamples=RESAMPLES,
        turn={"s": TURN_S, "deg": round(math.degrees(MIN_TURN_RAD)), "match_s": MATCH_S},
        samples=sum(trial.trial.rows for trial in result.trials),
        command=command,
        seconds=seconds,
        fbgraph=__version__,
        versions={name: version(name) for name in _PACKAGES},
        config=_configuration(result),
    )
