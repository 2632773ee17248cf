"""Online: the batch answer, for any chunks; live sources, junk, interruptions and crashes."""

import itertools
import json
import os
import random
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from fbgraph.core.config import Config, load_config
from fbgraph.core.errors import DataError
from fbgraph.core.log import SensorLog, Stream
from fbgraph.core.trajectory import Trajectory, read_tum
from fbgraph.estimators.answers import Update
from fbgraph.estimators.online import OnlineSmoother
from fbgraph.pipeline import reconstruct
from fbgraph.readers import preset, read_log
from fbgraph.readers.live_lines import LiveReader
from fbgraph.readers.raw_lines import saved_log
from fbgraph.run.metrics import score
from fbgraph.session import cut_log
from fbgraph.simulator.files import write_m5stickc_csv
from fbgraph.simulator.routes import load_route
from fbgraph.simulator.simulate import SimulateOptions, simulate


def feed(smoother: OnlineSmoother, log: SensorLog, chunk_s: float) -> list[Update]:
    edges = np.concatenate(([-np.inf], np.arange(chunk_s, log.duration_s, chunk_s), [np.inf]))
    return [u for lo, hi in itertools.pairwise(edges) for u in smoother.feed(log.between(lo, hi))]


def differences(a: Trajectory, b: Trajectory) -> tuple[float, float]:
    """RMS horizontal distance in metres, RMS yaw difference in degrees."""
    assert len(a) == len(b)
    yaw = (a.yaw_rad - b.yaw_rad + np.pi) % (2 * np.pi) - np.pi
    return float(np.sqrt(((a.xy_m - b.xy_m) ** 2).sum(axis=1).mean())), float(np.degrees(np.sqrt((yaw**2).mean())))


@pytest.mark.parametrize("chunk_s", [0.1, 0.03, 0.7, 1e9])
def test_a_replayed_log_is_the_log(chunk_s: float) -> None:
    """Cut into pieces, no sample is lost or doubled, also where it lies on a cut."""
    t_s = np.round(np.arange(0.0, 60.0, 0.01), 2)
    acc = Stream(t_s, np.tile(t_s[:, None], 3))
    mag = Stream(t_s[::7] + 1.0, np.tile(t_s[::7, None], 3))
    log = SensorLog(name="x", format="x", t0_s=0.0, acc=acc, gyro=acc, mag=mag)
    joined = SensorLog.concatenate([piece for piece, _ in cut_log(log, chunk_s, np.inf, lambda: False)])
    for name in ("acc", "gyro", "mag"):
        np.testing.assert_array_equal(getattr(joined, name).t_s, getattr(log, name).t_s)


def real_logs(shared_data: Path) -> list[Path]:
    indoor = sorted((shared_data / "indoor-location" / "site1").rglob("*.txt.gz"))
    return [*sorted((shared_data / "ipin2023").glob("*.gz")), *indoor[::8]]


@pytest.mark.parametrize("anchored", [False, True])
def test_the_end_is_the_batch_smoothers_on_real_walks(shared_data: Path, anchored: bool) -> None:
    paths = real_logs(shared_data)
    assert len(paths) == 18
    scores = []
    for path in paths:
        log_file = read_log(path)
        log, truth = log_file.log, log_file.truth
        assert truth is not None
        config = load_config(preset(log.format))
        anchors = truth.select(np.arange(0, len(truth), 3)) if anchored else None
        batch = reconstruct(log, config, anchors=anchors)
        smoother = OnlineSmoother(config, anchors, log.t0_s)
        feed(smoother, log, 0.7)
        distance_m, yaw_deg = differences(smoother.finish().trajectory, batch.smoothed.trajectory)
        assert distance_m < 0.05, path.name
        assert yaw_deg < 0.3, path.name
        scores.append([score(t, truth, log.t0_s).rmse_m for t in (smoother.causal, batch.trajectories["ekf"])])
    online, ekf = np.mean(scores, axis=0)
    assert anchored or online < ekf  # on the walk itself, unaided, the online estimate beats the EKF


@pytest.fixture(scope="module")
def half_hour() -> SensorLog:
    return simulate(load_route("out-and-back"), SimulateOptions(duration_s=1800.0), seed=2).log


def test_a_long_walk_through_a_short_window_ends_as_the_batch(half_hour: SensorLog) -> None:
    config = load_config("m5stickc", ["online.window_steps=100", "returning.out_and_back=false"])
    batch = reconstruct(half_hour, config)
    smoother = OnlineSmoother(config)
    updates = feed(smoother, half_hour, 5.0)
    window = smoother.estimate()
    distance_m, yaw_deg = differences(smoother.finish().trajectory, batch.smoothed.trajectory)
    assert distance_m < 0.05
    assert yaw_deg < 0.3
    assert [update.k for update in updates] == list(range(len(updates)))
    # what the last estimate says of now is close to what is known in the end
    end = batch.smoothed.trajectory
    assert np.hypot(window.x_m[-1] - end.x_m[-1], window.y_m[-1] - end.y_m[-1]) < 1.0


def test_updates_do_not_depend_on_the_chunks() -> None:
    log = simulate(load_route("square"), seed=5).log
    runs = []
    for chunk_s in (1e9, 1.0, 0.013):
        smoother = OnlineSmoother(load_config("m5stickc"))
        runs.append((feed(smoother, log, chunk_s), smoother.finish().trajectory))
    for updates, trajectory in runs[1:]:
        assert updates == runs[0][0]
        assert np.array_equal(trajectory.xy_m, runs[0][1].xy_m)


def test_no_step_is_an_error_only_at_the_end() -> None:
    log = simulate(load_route("square"), seed=5).log
    smoother = OnlineSmoother(Config())
    assert smoother.feed(log.between(-np.inf, 2.0)) == []
    with pytest.raises(DataError, match="no step"):
        smoother.finish()


@pytest.fixture(scope="module")
def lines(tmp_path_factory: pytest.TempPathFactory) -> list[str]:
    """A simulated walk as the device writes it."""
    path = tmp_path_factory.mktemp("live") / "walk.csv"
    write_m5stickc_csv(simulate(load_route("square"), seed=7).log, path)
    return path.read_text().splitlines(keepends=True)


def pushed(lines: list[str], chunk: int = 50) -> tuple[LiveReader, SensorLog]:
    reader = LiveReader()
    parts = [reader.push(lines[at : at + chunk]) for at in range(0, len(lines), chunk)]
    parts.append(reader.finish())
    streams = {
        name: replace(
            getattr(parts[0], name),
            t_s=np.concatenate([getattr(p, name).t_s for p in parts]),
            values=np.concatenate([getattr(p, name).values for p in parts]),
        )
        for name in ("acc", "gyro", "mag", "pressure")
    }
    return reader, replace(parts[0], t0_s=reader.t0_s, **streams)


def test_live_lines_give_what_the_file_gives(lines: list[str], tmp_path: Path) -> None:
    (tmp_path / "walk.csv").write_text("".join(lines))
    file = read_log(tmp_path / "walk.csv").log
    for chunk in (1, 17, len(lines)):
        _, live = pushed(lines, chunk)
        for name in ("acc", "gyro", "mag", "pressure"):
            assert np.array_equal(getattr(live, name).t_s, getattr(file, name).t_s)
            assert np.array_equal(getattr(live, name).values, getattr(file, name).values)


def walked(log: SensorLog) -> Trajectory:
    smoother = OnlineSmoother(load_config("m5stickc"))
    feed(smoother, log, 0.5)
    return smoother.finish().trajectory


def test_junk_costs_samples_but_never_the_walk(lines: list[str]) -> None:
    """Half lines, garbled numbers, lost lines, bursts, a restarted clock and a long silence."""
    rng = random.Random(3)
    clean = walked(pushed(lines)[1])
    header, rows = lines[0], lines[1:]
    half = len(rows) // 2
    junk = [header]
    for i, row in enumerate(rows):
        fields = row.split(",")
        if i >= half:  # the device restarted, after thirty seconds of silence that its own clock did not see
            fields[0] = str(int(fields[0]) - int(rows[half].split(",")[0]) + 12)
        if rng.random() < 0.10:
            continue
        if rng.random() < 0.01:
            junk.append(",".join(fields)[: rng.randrange(3, 30)] + "\n")
            continue
        if rng.random() < 0.01:
            fields[rng.randrange(1, 9)] = rng.choice(["", "NaN", "xx", "-", "1e99", "\x00\xff"])
        if rng.random() < 0.002:
            fields[0] = str(rng.randrange(10**12))
        junk.append(",".join(fields))
        if rng.random() < 0.002:
            junk.append(header)
    reader, log = pushed(junk, 13)
    assert reader.counts["clock_restarts"] == 1
    assert reader.counts["lines_unreadable"] > 20
    trajectory = walked(log)
    assert np.isfinite(trajectory.xy_m).all()
    hops = np.hypot(np.diff(trajectory.x_m), np.diff(trajectory.y_m))
    assert hops.max() < 1.5  # continuous
    assert abs(len(trajectory) - len(clean)) <= 4
    assert np.hypot(*(trajectory.xy_m[-1] - clean.xy_m[-1])) < 4.0


def test_a_silence_is_a_gap(lines: list[str]) -> None:
    rows = lines[:1500] + [
        ",".join([str(int(row.split(",")[0]) + 30_000), *row.split(",")[1:]]) for row in lines[1500:]
    ]
    reader, log = pushed(rows)
    assert reader.counts["silences"] == 1
    assert np.diff(log.acc.t_s).max() > 29.0
    trajectory = walked(log)
    assert np.hypot(np.diff(trajectory.x_m), np.diff(trajectory.y_m)).max() < 1.5


def command(*arguments: object) -> list[str]:
    return [sys.executable, "-m", "fbgraph", "online", *map(str, arguments), "--no-recording"]


@contextmanager
def running(*arguments: object, **options: object) -> Iterator[subprocess.Popen[bytes]]:
    process = subprocess.Popen(command(*arguments), stdout=subprocess.PIPE, stderr=subprocess.PIPE, **options)  # type: ignore[call-overload]
    try:
        yield process
    finally:
        if process.poll() is None:
            process.kill()
        process.wait()


def ended(process: subprocess.Popen[bytes], code: int = 0) -> str:
    out, err = process.communicate(timeout=60)
    assert process.returncode == code, err.decode()
    assert b"Traceback" not in err
    return out.decode()


def free_port(kind: socket.SocketKind = socket.SOCK_STREAM) -> int:
    with socket.socket(socket.AF_INET, kind) as probe:
        probe.bind(("127.0.0.1", 0))
        return int(probe.getsockname()[1])


def connected(port: int) -> socket.socket:
    for _ in range(200):
        try:
            return socket.create_connection(("127.0.0.1", port))
        except OSError:
            time.sleep(0.05)
    raise AssertionError("nobody listens")


@pytest.fixture(scope="module")
def reference(lines: list[str], tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The run folder of the whole walk from standard input, uninterrupted."""
    out = tmp_path_factory.mktemp("reference") / "run"
    done = subprocess.run(
        command("--source", "stdin", "--out", out, "--json"), input="".join(lines), capture_output=True, text=True
    )
    assert done.returncode == 0, done.stderr
    updates = [json.loads(line) for line in done.stdout.splitlines()]
    assert [u["k"] for u in updates[:-1]] == list(range(len(updates) - 1))
    assert updates[-1]["out"] == str(out)
    return out


def same_walk(run: Path, reference: Path) -> None:
    assert (run / "raw.csv").read_bytes() == (reference / "raw.csv").read_bytes()
    for name in ("online.tum", "smoothed.tum"):
        assert (run / name).read_text() == (reference / name).read_text(), name


def test_stdin_keeps_every_line_and_smooth_gives_the_same(reference: Path, lines: list[str], tmp_path: Path) -> None:
    assert (reference / "raw.csv").read_text() == "".join(lines)
    batch = reconstruct(read_log(reference / "raw.csv").log, load_config("m5stickc")).smoothed.trajectory
    distance_m, yaw_deg = differences(read_tum(reference / "smoothed.tum"), batch)
    assert distance_m < 0.05
    assert yaw_deg < 0.3


def test_a_serial_port(lines: list[str], reference: Path, tmp_path: Path) -> None:
    master, slave = os.openpty()
    import tty

    tty.setraw(slave)
    with running("--source", f"serial:{os.ttyname(slave)}@115200", "--out", tmp_path / "run") as process:
        raw = tmp_path / "run" / "raw.csv"
        while not raw.exists():
            time.sleep(0.05)
        time.sleep(0.5)  # opening the port empties its buffers
        data = "".join(lines).encode()
        for at in range(0, len(data), 2000):
            os.write(master, data[at : at + 2000])
        deadline = time.time() + 20
        while raw.stat().st_size < len(data) and time.time() < deadline:
            time.sleep(0.05)
        os.close(master)  # the cable is pulled
        process.send_signal(signal.SIGINT)
        ended(process)
    os.close(slave)
    same_walk(tmp_path / "run", reference)


def test_tcp_and_udp(lines: list[str], reference: Path, tmp_path: Path) -> None:
    port = free_port()
    with running("--source", f"tcp://:{port}", "--out", tmp_path / "tcp") as process:
        with connected(port) as device:
            device.sendall("".join(lines).encode())
        ended(process)
    same_walk(tmp_path / "tcp", reference)
    port = free_port(socket.SOCK_DGRAM)
    with running("--source", f"udp://127.0.0.1:{port}", "--out", tmp_path / "udp") as process:
        raw = tmp_path / "udp" / "raw.csv"
        while not raw.exists():
            time.sleep(0.05)
        time.sleep(0.2)
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as device:
            for at in range(0, len(lines), 20):
                device.sendto("".join(lines[at : at + 20]).encode(), ("127.0.0.1", port))
                time.sleep(0.004)
        time.sleep(0.5)
        process.send_signal(signal.SIGTERM)
        ended(process)
    assert len(read_tum(tmp_path / "udp" / "smoothed.tum")) >= 0.9 * len(read_tum(reference / "smoothed.tum"))


def test_ten_kills_lose_and_double_no_step(lines: list[str], reference: Path, tmp_path: Path) -> None:
    """The device sends again from the first line that was not saved, as one with a buffer does."""
    out, rng = tmp_path / "run", random.Random(11)
    for cycle in range(11):
        port = free_port()
        saved = (out / "raw.csv").read_bytes() if cycle else b""
        sent = saved.count(b"\n")
        how = ("--resume", out) if cycle else ("--out", out)
        with running("--source", f"tcp://:{port}", *how) as process, connected(port) as device:
            if cycle == 10:
                device.sendall("".join(lines[sent:]).encode())
                device.close()
                ended(process)
                break
            until = min(sent + rng.randrange(100, 600), len(lines) - 20)
            data = "".join(lines[sent:until]).encode()
            device.sendall(data[: len(data) - rng.randrange(0, 60)])  # possibly torn in a line
            if cycle == 0:
                while not (out / "raw.csv").exists():
                    time.sleep(0.02)
            time.sleep(rng.uniform(0.0, 0.4))
            process.send_signal(signal.SIGKILL)
            process.wait()
    same_walk(out, reference)


def test_resume_needs_a_walk_and_sources_are_checked(tmp_path: Path) -> None:
    for arguments, cause in (
        (("--source", "stdin", "--resume", tmp_path), "no walk"),
        (("--source", "carrier-pigeon", "--out", tmp_path / "run"), "expected stdin"),
        (("--out", tmp_path / "run"), "LOG"),
        (("nothing.csv", "--speed", "-1", "--out", tmp_path / "run"), ""),
    ):
        done = subprocess.run(command(*arguments), capture_output=True, text=True, stdin=subprocess.DEVNULL)
        assert done.returncode in (2, 3)
        assert cause in done.stderr
        assert done.stderr.count("\n") == 1


def test_saved_lines_are_the_samples_that_were_used(reference: Path, lines: list[str]) -> None:
    _, live = pushed(lines)
    saved = saved_log(reference / "raw.csv")
    assert np.array_equal(saved.acc.values, live.acc.values)
    assert saved.t0_s == live.t0_s
