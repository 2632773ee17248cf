"""What ``fuzz`` tries: each method of ``Work`` damages something, uses it as people do, and checks what comes of it."""

from __future__ import annotations

import contextlib
import io
import json
import random
import shutil
from pathlib import Path
from typing import Any

import click
import fuzz_inputs
import numpy as np
import tomli_w
import typer
from fuzz_inputs import damaged, mutated

from fbgraph.cli.app import app
from fbgraph.core.aids import Told
from fbgraph.core.building_files import parse_building_axis, read_building
from fbgraph.core.config import Config, dump_toml, load_config
from fbgraph.core.sensor_log import SensorLog
from fbgraph.exports import FORMATS
from fbgraph.pipeline import reconstruct, write_run
from fbgraph.readers import preset, read_log
from fbgraph.readers.layout import layout_toml
from fbgraph.readers.live_lines import LiveReader
from fbgraph.readers.numbered_lines import NumberedLines, numbered
from fbgraph.readers.phone_pushes import PushedRows
from fbgraph.readers.places import gnss_of, read_checkpoints
from fbgraph.readers.raw_recorder import LineCutter
from fbgraph.run.folder import claimed_run
from fbgraph.run.inputs import RunInputs
from fbgraph.run.read_run import read_directions, read_run, read_summary, score_run, trajectory_of
from fbgraph.simulator.files import write_m5stickc_csv, write_truth_csv
from fbgraph.simulator.routes import load_route
from fbgraph.simulator.simulate import simulate
from fbgraph.simulator.simulate_options import Device, SimulateOptions
from fbgraph.study.column_names import load_layout
from fbgraph.study.course import simulated_trials, write_trial
from fbgraph.study.dataset import read_dataset

SPRINT_M_S = 12.5
SMOOTHED_EVERY = 12  # logs that are read well are smoothed this often
BRIEF_S = 5.0
SHARES = (70, 27, 3)  # of the beginning of a short walk, all of it, and a longer one: what costs time comes seldom
_NUMBERS = (0, -1, 1e-300, 1e-9, 1e-4, 0.01, 0.5, 2, 10, 1e3, 1e9, 1e308, "inf", "nan", True, "[]", '"x"', "[0,0,1]")
_COMMAND = typer.main.get_command(app)
_PRINTED = ("text", "json", "geojson", "gpx", "csv")


class Work:
    """What is damaged, made once a process."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        short = SimulateOptions(device=Device(rate_hz=50.0))
        walk, longer = simulate(load_route("square", 0.2), short, seed=3), simulate(load_route("square"), seed=3)
        self.log = walk.log
        self.logs = [
            _written(walk.log.between(-np.inf, BRIEF_S), folder / "brief.csv"),
            _written(walk.log, folder / "walk.csv"),
            _written(longer.log, folder / "longer.csv"),
        ]
        write_truth_csv(walk, folder / "truth.csv", rate_hz=0.5)
        self.truth = (folder / "truth.csv").read_bytes()
        self.config = load_config("m5stickc")
        file, inputs = read_log(folder / "walk.csv"), RunInputs.of(folder / "walk.csv")
        assert file.reading is not None
        self.layout, self.config_toml = layout_toml(file.reading.layout).encode(), dump_toml(self.config).encode()
        with claimed_run(folder / "run") as claim:
            result = reconstruct(walk.log, self.config, Told(truth=read_checkpoints(folder / "truth.csv")), inputs)
            write_run(result, claim, recording=False)
        xy_m = result.smoothed.trajectory.xy_m[::2]
        self.places = fuzz_inputs.places(self.truth, xy_m, result.smoothed.trajectory.t_s[::2] + walk.log.t0_s)
        self.keys = [f"{t}.{k}" for t, values in self.config.model_dump().items() for k in values]
        _, trial, remark = next(iter(simulated_trials(1, 1)))
        write_trial(trial, folder / "trial.csv", remark)
        lines = (folder / "trial.csv").read_bytes().split(b"\n")
        self.trial = b"\n".join(lines[:400])

    def a_log(self, rng: random.Random) -> None:
        """A damaged log is read, and now and then smoothed."""
        path = self._odd_log(rng)
        rate_hz = 50.0 if rng.randrange(8) == 0 else None
        file = read_log(path, rate_hz=rate_hz)
        if path.suffix == ".zip" or path.is_dir():
            gnss_of(path)
        if rng.randrange(SMOOTHED_EVERY) == 0:
            believable(file.log, load_config(preset(file.log.format)), Told(truth=file.truth))

    def a_layout(self, rng: random.Random) -> None:
        """A log is read by a damaged layout."""
        path = damaged(rng, self.layout, self.folder, "layout.toml")
        read_log(self.folder / "walk.csv", layout=path)

    def live_lines(self, rng: random.Random) -> None:
        """Damaged lines come in pieces of any size."""
        data, reader, cutter = mutated(rng, self._bytes(rng)), LiveReader(), LineCutter()
        last_s, piece = -1.0, rng.choice((100, 3000, 20_000, 10**6))
        for at in range(0, len(data), piece):
            some = reader.push(cutter.push(data[at : at + piece]))
            assert not len(some.acc.t_s) or (np.diff(some.acc.t_s, prepend=last_s) > 0).all(), "time goes back"
            last_s = float(some.acc.t_s[-1]) if len(some.acc.t_s) else last_s
        reader.push(cutter.finish())
        reader.finish()

    def a_push(self, rng: random.Random) -> None:
        """Damaged pushes of a phone become rows, in order of time."""
        rows, lines = PushedRows(), []
        whole = self._some_logs(rng)["lines.json"]
        assert isinstance(whole, bytes)
        for body in mutated(rng, whole).split(b"\n"):
            with contextlib.suppress(ValueError, RecursionError):  # these are answered as no push
                message = json.loads(body)
                if isinstance(message, dict):
                    lines += rows.push(message).split(b"\n")
        lines += rows.finish().split(b"\n")
        times = [int(line.partition(b",")[0]) for line in lines if line[:1].isdigit()]
        assert times == sorted(times), "rows go back in time"

    def numbered_lines(self, rng: random.Random) -> None:
        """What a link loses, doubles and garbles: the lines of the file come once and in order."""
        lines = self._bytes(rng).split(b"\n")[:300]
        sent = [numbered("w1", i, line) for i, line in enumerate(lines)]
        link = NumberedLines()
        data, came, now_s = mutated(rng, b"".join(sent)), b"", 0.0
        for at in range(0, len(data), size := rng.choice((50, 500, 10**6))):
            now_s += rng.choice((0.01, 1.0, 40.0))
            came += link.push(data[at : at + size], now_s)
            link.requests(now_s)
        came += link.finish()
        place = {line: i for i, line in enumerate(lines)}
        order = [place[line] for line in came.split(b"\n") if line and line in place]
        assert (np.diff(order) > 0).all(), "lines twice or out of order"

    def a_building(self, rng: random.Random) -> None:
        """A damaged file of a building."""
        whole = tomli_w.dumps(parse_building_axis("70,2").model_dump(mode="json", exclude_none=True)).encode()
        read_building(damaged(rng, whole, self.folder, "building.toml"))

    def a_configuration(self, rng: random.Random) -> None:
        """Odd values of one to three keys, or a damaged file of them."""
        if rng.randrange(3) == 0:
            config = load_config(str(damaged(rng, self.config_toml, self.folder, "odd.toml")))
        else:
            keys = rng.sample(self.keys, rng.choice((1, 2, 3)))
            config = load_config("m5stickc", [f"{key}={rng.choice(_NUMBERS)}" for key in keys])
        if rng.randrange(3) == 0:
            believable(self.log, config, Told(), by_config=True)

    def some_places(self, rng: random.Random) -> None:
        """Damaged truth and anchors."""
        name = rng.choice(sorted(self.places))
        known = read_checkpoints(damaged(rng, self.places[name], self.folder, name))
        told = Told(truth=known) if rng.randrange(2) else Told(anchors=known)
        if rng.randrange(8) == 0:
            believable(self.log, self.config, told)

    def a_mapping(self, rng: random.Random) -> None:
        """A damaged mapping file."""
        whole = b'[dataset]\nrate_hz = 100.0\n[dataset.columns]\ntruth_x = ["x", "east"]\ntime = "t"\n'
        load_layout("forestback", mapping=damaged(rng, whole, self.folder, "odd.toml"))

    def a_data_set(self, rng: random.Random) -> None:
        """A damaged trial, alone or among others."""
        whole = self.trial if rng.randrange(2) else {"trial_01.csv": self.trial, "trial_02.csv": self.trial[:9000]}
        read_dataset(
            damaged(rng, whole, self.folder, "trials" if isinstance(whole, dict) else "t.csv"),
            load_layout("forestback"),
        )

    def a_run(self, rng: random.Random) -> None:
        """A damaged run folder is read, scored and followed back."""
        run = self._odd_run(rng)
        read_summary(run)
        saved = read_run(run)
        for estimator in saved.trajectories:
            trajectory = trajectory_of(saved, estimator)
            require_believable(trajectory.xy_m, trajectory.t_s)
        if rng.randrange(2):
            score_run(saved, read_checkpoints(self.folder / "truth.csv"))
        else:
            read_directions(saved)

    def a_run_command(self, rng: random.Random) -> None:
        """A damaged run folder is evaluated, exported or followed back from the command line."""
        run, kind, out = self._odd_run(rng), rng.randrange(3), str(self.folder / "out")
        where = ["--origin", "49.46,11.11"] if rng.randrange(2) else []
        if kind == 0:
            truth = rng.choice(("truth.csv", "odd-truth.csv"))
            (self.folder / "odd-truth.csv").write_bytes(mutated(rng, self.truth))
            require_json(said("evaluate", str(run), "--truth", str(self.folder / truth), "--json"))
        elif kind == 1:
            printed = rng.choice(_PRINTED)
            text = said("guide", str(run), "--format", printed, *where)
            if printed in ("json", "geojson"):
                require_json(text)
        else:
            said("export", str(run), "--to", rng.choice(sorted(FORMATS)), "--out", out, *where)

    def a_log_command(self, rng: random.Random) -> None:
        """A damaged log is inspected, or converted and read back the same."""
        path = self._odd_log(rng)
        if rng.randrange(2):
            require_json(said("inspect", str(path), "--json"))
            return
        out = self.folder / "converted.csv"
        for old in self.folder.glob("converted*"):
            old.unlink()
        said("convert", str(path), str(out))
        before, after = read_log(path).log, read_log(out).log
        assert len(before.acc.t_s) == len(after.acc.t_s), f"{len(before.acc.t_s)} samples, {len(after.acc.t_s)} back"

    def _some_logs(self, rng: random.Random) -> dict[str, fuzz_inputs.Input]:
        return rng.choices(self.logs, SHARES)[0]

    def _bytes(self, rng: random.Random) -> bytes:
        """A log that is one file."""
        found = self._some_logs(rng)[
            rng.choice(("walk.csv", "walk.csv", "long.csv", "walk.gcsv", "gsd.txt", "lines.json"))
        ]
        assert isinstance(found, bytes)
        return found

    def _odd_log(self, rng: random.Random) -> Path:
        logs = self._some_logs(rng)
        name = rng.choice(("walk.csv", "walk.csv", *sorted(logs)))
        return damaged(rng, logs[name], self.folder, name)

    def _odd_run(self, rng: random.Random) -> Path:
        """A run of which one file is damaged, by somebody who did not mind its digests."""
        run = self.folder / "odd-run"
        shutil.rmtree(run, ignore_errors=True)
        run.mkdir()
        names = sorted(p.name for p in (self.folder / "run").iterdir())
        files = {name: (self.folder / "run" / name).read_bytes() for name in names}
        if rng.randrange(4):
            summary = json.loads(files["summary.json"])
            summary.pop("sha256", None)
            files["summary.json"] = json.dumps(summary, indent=2).encode()
        name = rng.choice(names)
        if rng.randrange(20) == 0:
            files.pop(name)
        else:
            files[name] = mutated(rng, files[name])
        for name, data in files.items():
            (run / name).write_bytes(data)
        return run


def _written(log: SensorLog, path: Path) -> dict[str, fuzz_inputs.Input]:
    write_m5stickc_csv(log, path)
    return fuzz_inputs.logs(log, path.read_bytes())


def said(*arguments: str) -> str:
    """What a command prints to stdout."""
    out, err = (io.TextIOWrapper(io.BytesIO(), "utf-8", errors="backslashreplace") for _ in range(2))
    with contextlib.redirect_stdout(out), contextlib.redirect_stderr(err):
        try:
            _COMMAND.main(list(arguments), standalone_mode=False)
        except click.ClickException as error:
            raise AssertionError(f"{arguments[0]}: {error.format_message()}") from error
    out.flush()
    return out.buffer.getvalue().decode() if isinstance(out.buffer, io.BytesIO) else ""


def require_json(text: str) -> None:
    """Of numbers that are finite."""

    def refuse(constant: str) -> Any:
        raise AssertionError(f"{constant} in JSON")

    json.loads(text, parse_constant=refuse)


def believable(log: SensorLog, config: Config, told: Told, by_config: bool = False) -> None:
    """Smooth a walk; AssertionError if what comes out cannot have been walked."""
    result = reconstruct(log, config, told)
    for name, trajectory in result.trajectories.items():
        assert np.isfinite(trajectory.xy_m).all(), f"{name} is not finite"
        free = by_config or (name == "smoothed" and told.anchors is not None)
        if not free:
            require_believable(trajectory.xy_m, trajectory.t_s)


def require_believable(xy_m: np.ndarray, t_s: np.ndarray) -> None:
    """Nowhere faster than a sprinter."""
    steps_m, dt_s = np.hypot(*np.diff(xy_m, axis=0).T), np.diff(t_s)
    fast = steps_m > SPRINT_M_S * dt_s + 1.0
    assert not fast.any(), f"{steps_m[fast][:1]} m in {dt_s[fast][:1]} s"


KINDS = {
    **{"a_log": 8, "a_log_command": 3, "live_lines": 1, "a_layout": 4, "some_places": 6, "a_run": 6},
    **{"a_run_command": 6, "a_configuration": 3, "a_mapping": 1, "a_data_set": 3},
    **{"a_push": 2, "numbered_lines": 2, "a_building": 1},
}
"""Methods of ``Work``, and how often each is drawn."""
