"""The ForestBack paper's evaluation, reproduced: fit, run all methods on the same steps, score, compare, write.

Every method gets the same detected steps and the same fitted λ, L0, α, β, γ, so that they differ in estimation only:
plain PDR and the heading EKF are the paper's, the smoother and iSAM2 are ours, with the weights of the configuration,
which nothing here fits. No estimator sees ground truth, labels or the end of the route.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path

import numpy as np

from fbgraph.core.config import Config
from fbgraph.core.errors import ConfigError, DataError, FbgraphError
from fbgraph.core.geometry import FloatArray
from fbgraph.core.whole_writes import is_leftover, locked, whole_folder
from fbgraph.estimators.baselines import baselines
from fbgraph.estimators.batch_smoother import smooth
from fbgraph.estimators.online_smoother import OnlineSmoother
from fbgraph.front_end.detect_steps import detect_steps
from fbgraph.front_end.step_track import StepTrack
from fbgraph.study.calibration import LAMBDAS, Evidence, StepModel, evidence, fit, map_offset_rad
from fbgraph.study.column_names import DatasetConfig
from fbgraph.study.comparison import Comparison, Overall, current_of, interval_of_mean, paired
from fbgraph.study.dataset import Dataset, read_dataset
from fbgraph.study.protocol import (
    LABELS,
    MethodResult,
    StudyResult,
    TrialResult,
    reference_turns,
    score_logged,
    score_trajectory,
)
from fbgraph.study.trial import LOGGED, Trial, Turns

SIMULATED = "simulated"
"""Asked for instead of a data set."""
Progress = Callable[[str, float], None]
"""Called with the name of a stage and how much of it is done."""
_PAIRS = (
    ("ekf", "pdr"),
    ("smoothed", "pdr"),
    ("smoothed", "ekf"),
    ("online", "ekf"),
    ("smoothed", "online"),
    ("logged_forestback", "logged_pdr"),
    ("smoothed", "logged_forestback"),
)
_MAP_NOTICE_RAD = np.radians(15.0)  # further off than this, the compass and the map do not share their North
_FILES = {
    *("report.html", "table.csv", "table.md", "table.tex", "trials.csv", "summary.json", "config.toml", "study.rrd"),
    *("figures", "trials"),
}


def run_study(dataset: Dataset, config: Config, progress: Progress = lambda stage, share: None) -> StudyResult:
    """The evaluation of a data set.

    Args:
        dataset: its trials.
        config: where fitting starts, and the weights of filter and graph.
        progress: told each stage.

    Raises:
        DataError: no trial with steps, or nothing to fit to.
    """
    skipped = list(dataset.skipped)
    trials = [(trial, reference_turns(trial)) for trial in dataset.trials]
    tried: list[dict[float, Evidence]] = []
    for number, (trial, turns) in enumerate(trials):
        progress("fit", number / len(trials))
        tried.append({value: evidence(_steps_at(trial, config, value), trial, turns) for value in LAMBDAS})
    walked = [any(len(e.segments) for e in of_trial.values()) for of_trial in tried]
    skipped += [
        (trial.name, "no step found: nobody walks in it, or its accelerometer is in another unit than its name says")
        for (trial, _), found in zip(trials, walked, strict=True)
        if not found
    ]
    if not any(walked):
        raise DataError(f"{dataset.source}: no step found in any of {len(trials)} trials")
    trials = [pair for pair, found in zip(trials, walked, strict=True) if found]
    tried = [of_trial for of_trial, found in zip(tried, walked, strict=True) if found]

    model = _fit(tried, config)
    results: list[TrialResult] = []
    held_out_models: list[StepModel] = []
    tracks: list[StepTrack] = []
    for number, (trial, turns) in enumerate(trials):
        progress("estimate", number / len(trials))
        try:
            result, track = _run_trial(trial, turns, model.apply(config))
            if len(trials) > 1:
                held_out = _fit([t for k, t in enumerate(tried) if k != number], config)
                again, _ = _run_trial(trial, turns, held_out.apply(config))
                rmse = {name: method.rmse_m for name, method in again.methods.items() if not name.startswith("logged")}
                result = replace(result, held_out_rmse_m=rmse)
                held_out_models.append(held_out)
        except FbgraphError as error:
            skipped.append((trial.name, str(error).removeprefix(f"{trial.name}: ")))
            continue
        results.append(result)
        tracks.append(track)
    if not results:
        raise DataError(f"{dataset.source}: no trial could be estimated. {skipped[-1][0]}: {skipped[-1][1]}")
    return StudyResult(
        source=dataset.source,
        simulated=dataset.simulated,
        config=model.apply(config),
        layout=dataset.layout,
        model=model,
        held_out_models=tuple(held_out_models),
        trials=tuple(results),
        skipped=tuple(skipped),
        comparison=_compare(results),
        notices=tuple(_notices(results, tracks)),
    )


def _steps_at(trial: Trial, config: Config, lambda_sigma: float) -> StepTrack | None:
    steps = config.steps.model_copy(update={"lambda_sigma": lambda_sigma})
    try:
        return detect_steps(trial.log, config.model_copy(update={"steps": steps}))[0]
    except DataError:
        return None


def _fit(tried: Sequence[dict[float, Evidence]], config: Config) -> StepModel:
    return fit({value: [of_trial[value] for of_trial in tried] for value in LAMBDAS}, config)


def _run_trial(trial: Trial, turns: Turns, config: Config) -> tuple[TrialResult, StepTrack]:
    """All methods on one trial.

    Raises:
        DataError: no step.
        EstimationError: a solver failed.
    """
    track, signals = detect_steps(trial.log, config)
    compared = baselines(track, config)
    online = OnlineSmoother(config)
    online.feed(trial.log)
    finished = online.finish().trajectory
    trajectories = {
        **compared,
        "online": online.causal,  # each step as it was known when it was made
        "finished": finished,
        "smoothed": smooth(track, compared["ekf"], config.graph, config.solver).trajectory,
    }
    methods: dict[str, MethodResult] = {
        f"logged_{method}": score_logged(trial, turns, method, track) for method in LOGGED if method in trial.logged
    }
    methods |= {n: score_trajectory(trial, turns, t, track, signals) for n, t in trajectories.items()}
    return TrialResult(trial, turns, len(track) - 1, methods, {}), track


def _compare(results: list[TrialResult]) -> Comparison:
    names = [name for name in LABELS if all(name in result.methods for result in results)]
    rmse = {name: np.array([result.methods[name].rmse_m for result in results]) for name in names}
    return Comparison(
        overall={name: _overall(name, results, rmse[name], rmse["pdr"]) for name in names},
        paired=tuple(paired(a, b, rmse[a], rmse[b]) for a, b in _PAIRS if a in rmse and b in rmse),
        current=current_of([result.trial.current_ma for result in results]),
    )


def _overall(name: str, results: list[TrialResult], rmse_m: FloatArray, pdr_m: FloatArray) -> Overall:
    methods = [result.methods[name] for result in results]
    # the authors' own outputs are compared with their own baseline
    if name == "logged_forestback" and all("logged_pdr" in result.methods for result in results):
        pdr_m = np.array([result.methods["logged_pdr"].rmse_m for result in results])
    baseline = name in ("pdr", "logged_pdr")
    matched, missed, false = (sum(getattr(m.turns, count) for m in methods) for count in ("matched", "missed", "false"))
    late = np.concatenate([m.turns.late_s for m in methods])
    heading = np.concatenate([m.heading_error_rad for m in methods])
    low, high = interval_of_mean(rmse_m)
    nan = float("nan")

    def share(part: int, whole: int) -> float:
        return part / whole if whole else nan

    return Overall(
        rmse_m=float(rmse_m.mean()),
        rmse_sd_m=float(rmse_m.std(ddof=1)) if len(rmse_m) > 1 else nan,
        rmse_median_m=float(np.median(rmse_m)),
        rmse_low_m=low,
        rmse_high_m=high,
        mean_m=float(np.mean([m.mean_m for m in methods])),
        max_m=float(np.mean([m.max_m for m in methods])),
        final_m=float(np.mean([m.final_m for m in methods])),
        held_out_rmse_m=float(np.mean([result.held_out_rmse_m.get(name, nan) for result in results])),
        improvement_percent=nan if baseline else float(np.mean(100.0 * (pdr_m - rmse_m) / pdr_m)),
        improvement_of_means_percent=nan if baseline else float(100.0 * (1.0 - rmse_m.mean() / pdr_m.mean())),
        turns_matched=matched,
        turns_missed=missed,
        turns_false=false,
        turn_precision=share(matched, matched + false),
        turn_recall=share(matched, matched + missed),
        turn_consistency_percent=100.0 * share(matched, matched + missed + false),
        turn_late_s=float(late.mean()) if len(late) else nan,
        turn_apart_s=float(np.abs(late).mean()) if len(late) else nan,
        heading_rms_deg=float(np.degrees(np.sqrt((heading**2).mean()))) if len(heading) else nan,
    )


def _notices(results: list[TrialResult], tracks: list[StepTrack]) -> Iterator[str]:
    """What the trials' readers and the fit want the user to know; each said once."""
    by_text: dict[str, list[str]] = {}
    for result in results:
        for text in result.trial.log.notices:
            by_text.setdefault(text, []).append(result.trial.name)
    for text, names in by_text.items():
        yield text if len(names) == len(results) else f"{text} ({', '.join(names[:3])}{', …' * (len(names) > 3)})"
    offset, sigma = map_offset_rad(tracks, [result.trial for result in results])
    if abs(offset) > _MAP_NOTICE_RAD and abs(offset) > 3.0 * sigma:
        yield (
            f"the compass is {np.degrees(offset):+.1f}° ± {np.degrees(sigma):.1f}° off the map's directions in all "
            f"trials: turn the map with --set dataset.map_yaw_deg={np.degrees(offset):.0f}, or set device.mount"
        )
    for method in LOGGED:
        apart = [
            np.abs(result.trial.logged_error_m[method] - result.methods[f"logged_{method}"].error_m).mean()
            for result in results
            if method in result.trial.logged_error_m
            and len(result.trial.logged_error_m[method]) == len(result.methods[f"logged_{method}"].error_m)
        ]
        if apart:
            yield f"{LABELS[f'logged_{method}']}: its error column is {np.nanmean(apart):.3f} m off on average"
    if all(result.trial.turns is None for result in results):
        yield "no turn labels: the turns of the ground truth stand in for them"


def study_files(
    source: str,
    out: Path,
    config: Config,
    layout: DatasetConfig,
    seed: int = 1,
    count: int | None = None,
    command: str = "",
    progress: Progress = lambda stage, share: None,
    max_size: int | None = None,
) -> StudyResult:
    """Read or simulate the trials, run the study and write its folder, whole or not at all.

    Args:
        source: a data set's path, or ``SIMULATED``.
        out: the folder; an earlier study there is replaced.
        config: the effective configuration.
        layout: of the data set.
        seed: of the simulation.
        count: how many trials; 36 or all if None.
        command: what was typed, for the report.
        progress: told each stage.
        max_size: bytes of text that are read of the data set at most; 1 GiB if None.

    Raises:
        ConfigError: ``out`` is no study folder or cannot be written.
        DataError: see ``read_dataset`` and ``run_study``.
    """
    from fbgraph.study.report import write_report  # matplotlib and rerun take two seconds to import

    began = time.perf_counter()
    if source != SIMULATED and Path(source).resolve().is_relative_to(out.resolve()):
        raise ConfigError(f"--out {out}: would replace the data set {source}; name another folder")
    with study_folder(out) as folder:
        if source == SIMULATED:
            from fbgraph.study.course import TRIALS, simulated_trials, write_trial

            (folder / "trials").mkdir()
            for number, (name, walk, remark) in enumerate(simulated_trials(seed, count or TRIALS)):
                progress("simulate", number / (count or TRIALS))
                write_trial(walk, folder / "trials" / f"{name}.csv", remark)
            # read back what was written, so that the written trials give the very same study
            dataset = replace(read_dataset(folder / "trials", layout), source=SIMULATED)
        else:
            progress("read", 0.0)
            dataset = read_dataset(Path(source), layout, count, max_size)
        result = run_study(dataset, config, progress)
        write_report(result, folder, command, began, progress)
    return result


@contextmanager
def study_folder(out: Path) -> Iterator[Path]:
    """A folder to write into that becomes ``out`` when the block ends well, and vanishes when it does not.

    Raises:
        ConfigError: ``out`` holds anything but an earlier study, or its parent cannot be written.
    """

    def check(place: Path) -> None:
        names = {e.name for e in place.iterdir() if not is_leftover(e.name)} if place.is_dir() else set()
        if place.exists() and (not place.is_dir() or names - _FILES or (names and "report.html" not in names)):
            raise ConfigError(f"--out {out}: exists and is not a study folder; name another, or remove it")

    with locked(out) as place, whole_folder(place, check=check) as folder:
        yield folder
