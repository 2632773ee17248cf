"""Input that cannot be a walk: how the command ends, and that it names the cause."""

import gzip
from pathlib import Path

import numpy as np
import pytest
from support.commands import fbgraph

HEADER = "t_ms,ax_g,ay_g,az_g,gx_dps,gy_dps,gz_dps,mx_ut,my_ut,mz_ut,p_hpa\n"


@pytest.fixture(scope="module")
def walk(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A simulated M5StickC log; its truth lies beside it."""
    folder = tmp_path_factory.mktemp("walk")
    fbgraph("simulate", folder / "walk.csv", "--route", "square", "--seed", 3)
    return folder / "walk.csv"


def rows(count: int, acc: str = "0.0,0.0,1.0", t_ms: int = 10) -> str:
    return "".join(f"{k * t_ms},{acc},0.1,0.2,0.3,20,5,-40,1000.0\n" for k in range(count))


def noisy(count: int) -> str:
    rng = np.random.default_rng(0)
    return "".join(
        f"{k * 10},{a:.4f},{b:.4f},{1 + c:.4f},0.1,0.2,0.3,20,5,-40,1000.0\n"
        for k, (a, b, c) in enumerate(rng.normal(0, 0.002, (count, 3)))
    )


BAD = {
    "empty": (b"", "empty"),
    "binary": (bytes(range(256)) * 50, "binary"),
    "unknown": (b"once upon a time\nthere was a log\n" * 20, "no accelerometer"),
    "header only": (HEADER.encode(), "no rows of numbers"),
    "no accelerometer": (
        b"t_ms,gx_dps,gy_dps,gz_dps\n" + b"".join(b"%d,1,2,3\n" % (10 * k) for k in range(900)),
        "accelerometer",
    ),
    "three samples": ((HEADER + rows(3)).encode(), "too short"),
    "all constant": ((HEADER + rows(2000)).encode(), "never changes"),
    "no step": ((HEADER + noisy(2000)).encode(), "no step"),
    "backwards": ((HEADER + "".join(noisy(900).splitlines(keepends=True)[::-1])).encode(), "backwards"),
    "truncated gz": (gzip.compress((HEADER + noisy(3000)).encode())[:-3000], "truncated"),
}


@pytest.mark.parametrize(("content", "cause"), BAD.values(), ids=BAD.keys())
def test_bad_input_ends_with_code_3_and_one_line_that_names_the_cause(
    tmp_path: Path, content: bytes, cause: str
) -> None:
    log = tmp_path / "bad.csv"
    log.write_bytes(content)
    done = fbgraph("smooth", log, "--out", tmp_path / "run", code=3)
    assert done.stderr.count("\n") == 1
    assert cause in done.stderr
    assert "bad" in done.stderr
    assert not (tmp_path / "run").exists()


def test_a_folder_or_a_missing_file_is_bad_data_too(tmp_path: Path) -> None:
    assert "no file in it" in fbgraph("smooth", tmp_path, code=3).stderr
    assert "No such file" in fbgraph("smooth", tmp_path / "nothing.csv", code=3).stderr


def test_truth_of_another_clock_is_refused(walk: Path, tmp_path: Path) -> None:
    truth = tmp_path / "truth.csv"
    truth.write_text("t_s,x_m,y_m\n900000,0,0\n900010,1,1\n")
    assert "clock" in fbgraph("smooth", walk, "--out", tmp_path / "run", "--truth", truth, code=3).stderr
    truth.write_text("t_s,x_m\n1,2\n")
    assert "y_m" in fbgraph("smooth", walk, "--out", tmp_path / "run", "--truth", truth, code=3).stderr
