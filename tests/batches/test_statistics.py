from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest

from fbgraph.batches.changes import changes
from fbgraph.batches.index import Rows, index_frame, read_index, write_index
from fbgraph.batches.index_row import COLUMNS
from fbgraph.batches.report_tables import changed_rows, changed_text, error_rows, headline, paired_rows, worst_rows
from fbgraph.batches.statistics import (
    best_rmse_m,
    coverage_of,
    errors_of,
    failures_of,
    mean_of,
    quantile_of,
    verdict_counts,
    worst_of,
)
from fbgraph.core.errors import DataError


def frame_of(*rows: dict[str, Any]) -> pd.DataFrame:
    kept = Rows(len(rows))
    for number in reversed(range(len(rows))):  # they come in any order
        kept.put(number, rows[number])
    return index_frame(kept)


def done(name: str, rmse_m: float | None = None, **cells: Any) -> dict[str, Any]:
    row = {"name": name, "status": "done", "verdict": "sound", "run": f"runs/{name}", "end_x_m": 1.0, "end_y_m": 0.0}
    row |= {"end_z_m": 0.0, "walk_s": 1800.0, "distance_m": 500.0, "end_2sigma_m": 2.0}
    return {**row, **({} if rmse_m is None else {"smoothed_rmse_m": rmse_m}), **cells}


def failed(name: str, cause: str = "data", reason: str = "no") -> dict[str, Any]:
    return {"name": name, "status": "failed", "cause": cause, "reason": reason}


def test_rows_come_back_in_the_order_of_the_logs() -> None:
    frame = frame_of(done("a", 1.5), failed("b"), done("c", steps=7))
    assert list(frame["name"]) == ["a", "b", "c"]
    assert frame.dtypes.astype(str).to_dict() == COLUMNS
    assert frame["smoothed_rmse_m"].isna().tolist() == [False, True, True]
    assert frame["steps"][2] == 7


def test_an_index_is_read_as_it_was_written(tmp_path: Path) -> None:
    frame = frame_of(done("=1+1", 1.5, turned_back=True), failed("b", reason="\x1b[2J"))
    write_index(frame, str(tmp_path))
    pd.testing.assert_frame_equal(read_index(str(tmp_path)), frame)
    rows = (tmp_path / "index.csv").read_text().splitlines()
    assert rows[1].startswith("'=1+1,,done,")
    assert "\\x1b[2J" in rows[2]
    assert "\x1b" not in rows[2]
    (tmp_path / "index.parquet").write_bytes(b"PAR1")
    with pytest.raises(DataError, match=r"index\.parquet is damaged"):
        read_index(str(tmp_path))
    with pytest.raises(DataError, match="no batch"):
        read_index(str(tmp_path / "nowhere"))


def test_quantiles_lie_between_order_statistics() -> None:
    values = np.arange(1.0, 101.0)
    half = quantile_of(values, 0.5)
    assert (half.value, half.low, half.high) == (50.5, 40.0, 61.0)  # the textbook's interval of the median of a hundred
    most = quantile_of(values, 0.95)
    assert most.value == pytest.approx(95.05)
    assert (most.low, most.high) == (90.0, 100.0)
    assert np.isnan(quantile_of(np.array([1.0, 2.0]), 0.95).high)  # two walks do not tell
    assert np.isnan(quantile_of(np.array([]), 0.5).value)


def test_intervals_hold_as_often_as_they_say() -> None:
    rng, held = np.random.default_rng(1), 0
    for _ in range(400):
        found = quantile_of(rng.exponential(size=60), 0.5)
        held += found.low <= np.log(2.0) <= found.high
    assert 0.93 <= held / 400 <= 0.995


def test_means() -> None:
    many = np.tile([1.0, 3.0], 1000)
    found = mean_of(many)
    half = 1.959964 * float(many.std(ddof=1)) / np.sqrt(2000.0)
    assert (found.value, found.low, found.high) == pytest.approx((2.0, 2.0 - half, 2.0 + half))
    few = mean_of(np.array([1.0, 2.0, 3.0, 10.0]))
    assert few.value == 4.0
    assert few.low < 4.0 < few.high
    assert mean_of(np.array([5.0])).text() == "5.00"
    assert mean_of(np.array([])).text() == "–"


def test_figures_of_a_batch() -> None:
    frame = frame_of(
        done("a", 1.0, ekf_rmse_m=2.0, inside_95=9, ellipses=10),
        done("b", 3.0, ekf_rmse_m=4.0, inside_95=1, ellipses=10, verdict="doubtful"),
        done("c", ekf_rmse_m=9.0, verdict="withheld"),
        failed("d"),
        failed("e", "time-out", "slow"),
        failed("f", "data", "other"),
    )
    ekf, smoothed = errors_of(frame)
    assert (ekf.estimator, ekf.walks, ekf.mean.value, ekf.worst_m) == ("ekf", 3, 5.0, 9.0)
    assert (smoothed.walks, smoothed.quantiles[0].value) == (2, 2.0)
    covered = coverage_of(frame)
    assert covered is not None
    assert covered[:2] == (10, 20)
    assert covered[2].value == pytest.approx(50.0)
    assert verdict_counts(frame) == {"sound": 1, "doubtful": 1, "withheld": 1}
    assert [(one.cause, one.logs, one.name) for one in failures_of(frame)] == [("data", 2, "d"), ("time-out", 1, "e")]
    assert best_rmse_m(frame).tolist()[:3] == [1.0, 3.0, 9.0]
    assert list(worst_of(frame, 2)["name"]) == ["c", "b"]
    assert headline(frame) == ("6 logs: 3 done (1 sound, 1 doubtful, 1 withheld), 3 failed; 1.5 km in 1.5 h of walking")
    assert worst_rows(frame, 1)[1] == ["c", "9.00", "–", "500.00", "2.00", "withheld", ""]


def test_without_truth_the_least_sure_are_the_worst() -> None:
    frame = frame_of(
        done("a"), done("b", end_2sigma_m=9.0), done("c", verdict="withheld"), done("d", verdict="doubtful")
    )
    assert list(worst_of(frame)["name"]) == ["c", "d", "b", "a"]
    assert errors_of(frame) == []
    assert coverage_of(frame) is None
    assert len(error_rows(frame)) == 1


def test_what_changed_between_two_batches() -> None:
    before = frame_of(
        done("a", 1.0), done("b", 2.0), done("c", 3.0), failed("d"), done("e"), done("old"), done("f", 1.0)
    )
    after = frame_of(
        done("new"),
        done("c", 2.0),
        done("a", 1.0005),
        done("b", 2.5),
        done("d", 1.0),
        done("e", end_x_m=1.4),
        done("f", 1.0, verdict="doubtful"),
    )
    found = changes(before, after)
    (paired,) = found.paired
    assert (paired.walks, paired.better, paired.worse) == (4, 1, 1)
    assert paired.difference.value == pytest.approx((0.0005 + 0.5 - 1.0) / 4)
    assert (found.both, found.only_before, found.only_after) == (6, ("old",), ("new",))
    assert list(found.walks["name"]) == ["d", "c", "b", "e", "f"]
    assert list(found.walks["what"]) == ["done now", "", "", "", "sound, now doubtful"]
    assert found.walks["difference_m"][1] == pytest.approx(-1.0)
    assert found.walks["end_moved_m"][3] == pytest.approx(0.4)
    assert changed_text(found) == "5 of 6 walks changed; 1 only in the first (old); 1 only in the second (new)"
    assert changed_rows(found)[2] == ["c", "3.00", "2.00", "-1.000", "0.00", ""]
    assert paired_rows(found)[1][:4] == ["smoothed", "4", "1.750", "1.625"]


def test_equal_batches_differ_in_nothing() -> None:
    frame = frame_of(done("a", 1.0), done("b", 2.0), failed("c"))
    found = changes(frame, frame)
    assert len(found.walks) == 0
    assert paired_rows(found)[1][-1] == "–"
    assert found.paired[0].difference.value == 0.0
    with pytest.raises(DataError, match="no log in common"):
        changes(frame, frame_of(done("x")))
