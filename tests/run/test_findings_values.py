"""What is told of a walk made by hand: each limit that a sentence rests on, on both of its sides."""

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from support.by_hand import way_along
from support.results_by_hand import T0_S, changed, hand_result, hand_signals, residuals, with_cov

from fbgraph.core.aids import Told
from fbgraph.core.checkpoints import Checkpoints, checkpoints
from fbgraph.core.trajectory import Trajectory
from fbgraph.run.finding import Finding
from fbgraph.run.findings import walk_findings
from fbgraph.run.walk_result import WalkResult
from fbgraph.way_back.records import Closure

WAY = way_along((0.0, 0.0), (25.0, 0.0), t0_s=1.0)  # 50 steps of 0.5 m and 0.5 s, from 1 s to 26 s
EVERY = np.ones(51)


def told(result: WalkResult, kind: str) -> list[Finding]:
    return [finding for finding in walk_findings(result) if finding.kind == kind]


def texts(result: WalkResult, kind: str) -> list[str]:
    return [finding.text for finding in told(result, kind)]


def compassed(weights: dict[int, float], off_deg: float = 0.0, norm: Any = 50.0) -> WalkResult:
    columns = {"yaw_mag_rad": math.radians(off_deg) * EVERY, "mag_norm_ut": norm * EVERY, "mag_dip_rad": EVERY}
    return hand_result(WAY, steps=columns, smoothed={"residuals": (residuals("compass", weights),)})


def test_a_compass_is_doubted_at_less_than_half_its_pull() -> None:
    norm = changed(51, [12], 57.6, 50.0)
    norm[14] = 44.4
    (finding,) = told(compassed(dict.fromkeys(range(10, 20), 0.49), 30.0, norm), "compass")
    assert finding.text == (
        "compass doubted for 5 m (steps 10 to 19): up to 30° off to the left of the smoothed heading, field 44 to 58 µT"
    )
    assert (finding.start_s, finding.end_s) == (5.5, 10.5)
    assert told(compassed(dict.fromkeys(range(10, 20), 0.51)), "compass") == []


def test_the_compass_is_off_to_its_side_and_beyond_a_right_angle_useless() -> None:
    doubted = dict.fromkeys(range(10, 20), 0.1)
    assert "up to 30° off to the right of" in texts(compassed(doubted, -30.0), "compass")[0]
    assert "up to 89° off to the left of" in texts(compassed(doubted, 89.0), "compass")[0]
    assert "useless, more than 90° off the smoothed heading" in texts(compassed(doubted, 91.0), "compass")[0]
    assert "useless" in texts(compassed(doubted, -91.0), "compass")[0]
    assert "up to 10° off to the left" in texts(compassed(doubted, 370.0), "compass")[0]


def test_the_worst_of_a_stretch_is_told() -> None:
    heading, norm = changed(51, [19], math.radians(-25.0), math.radians(10.0)), changed(51, [19], 61.0, 50.0)
    columns: dict[str, Any] = {"yaw_mag_rad": heading, "mag_norm_ut": norm, "mag_dip_rad": EVERY}
    loss = residuals("compass", dict.fromkeys(range(10, 20), 0.1))
    (text,) = texts(hand_result(WAY, None, columns, {"residuals": (loss,)}), "compass")
    assert text.endswith("up to 25° off to the right of the smoothed heading, field 50 to 61 µT")


def test_off_is_off_the_smoothed_heading_not_off_east() -> None:
    north = way_along((0.0, 0.0), (0.0, 25.0), t0_s=1.0)
    columns = {"yaw_mag_rad": math.radians(120.0) * EVERY, "mag_norm_ut": 50.0 * EVERY, "mag_dip_rad": EVERY}
    loss = residuals("compass", dict.fromkeys(range(10, 20), 0.1))
    (text,) = texts(hand_result(north, None, columns, {"residuals": (loss,)}), "compass")
    assert "up to 30° off to the left" in text


def test_a_stretch_from_the_first_breadcrumb_has_no_step_before_it() -> None:
    (text,) = texts(compassed(dict.fromkeys(range(4), 0.1)), "compass")
    assert text.startswith("compass doubted for 2 m (steps 0 to 3)")


@pytest.mark.parametrize(
    ("factor", "text"),
    [
        (0.69, "steps 10 to 13 much slower than usual (1.4 against 2.0 Hz): some may have been missed"),
        (0.71, None),
        (1.39, None),
        (1.41, "steps 10 to 13 much faster than usual (2.8 against 2.0 Hz): some may be false"),
    ],
)
def test_steps_much_slower_or_faster_than_usual_are_told(factor: float, text: str | None) -> None:
    result = hand_result(WAY, steps={"frequency_hz": changed(51, slice(10, 14), 2.0 * factor, 2.0)})
    assert texts(result, "steps") == ([] if text is None else [text])
    if text is not None:
        assert [(f.start_s, f.end_s) for f in told(result, "steps")] == [(5.5, 7.5)]


def test_the_rate_told_is_the_median_of_the_stretch() -> None:
    frequency = changed(51, [1, 2], 1.2, 2.0)
    frequency[2] = 0.6
    result = hand_result(WAY, steps={"frequency_hz": frequency})
    assert texts(result, "steps")[0].startswith("steps 1 to 2 much slower than usual (0.9 against 2.0 Hz)")


def test_the_standing_start_has_no_frequency() -> None:
    frequency = changed(51, [0, 1], 0.1, 2.0)
    assert texts(hand_result(WAY, steps={"frequency_hz": frequency}), "steps") == []
    half = np.where(np.arange(51) <= 25, 2.0, 2.9)  # usual is 2.45 Hz: with the standing start it would be 2
    half[0] = 0.0
    assert texts(hand_result(WAY, steps={"frequency_hz": half}), "steps") == []


def paused(pause_s: float, still: bool = False) -> WalkResult:
    """Fifty steps with a pause before the 20th, which begins at 10.5 s."""
    later = np.where(np.arange(51) >= 20, pause_s, 0.0)
    way = replace(WAY, t_s=WAY.t_s + later)
    start_s = np.concatenate(([1.0], way.t_s[1:] - 0.5))
    stands = np.zeros(601, dtype=bool)
    stands[105 : 105 + round(10 * pause_s)] = still
    return hand_result(way, steps={"start_s": start_s}, signals=hand_signals(60.0, stands))


def test_three_seconds_without_a_step_are_told() -> None:
    assert texts(paused(2.9), "steps") == []
    (finding,) = told(paused(3.2), "steps")
    assert finding.text == "neither still nor stepping for 3 s: handling, turning on the spot, missed steps"
    assert (finding.start_s, finding.end_s) == pytest.approx((10.5, 13.7))
    assert texts(paused(8.0, still=True), "steps") == []


def test_before_the_first_step_and_after_the_last_nothing_is_missed() -> None:
    late = replace(WAY, t_s=WAY.t_s + 9.0)
    assert texts(hand_result(late, signals=hand_signals(60.0)), "steps") == []


def test_gaps_are_told_one_by_one() -> None:
    found = told(hand_result(WAY, steps={"chained": [k not in (10, 30) for k in range(51)]}), "gap")
    assert [(f.start_s, f.end_s) for f in found] == [(5.5, 6.0), (15.5, 16.0)]
    assert found[0].text == "gap in the log: direction across it is the compass's"


def anchored(weight: float | None = None) -> WalkResult:
    """The smoothed walk passes 0.6 m beside an anchor at step 20, the EKF's 3 m."""
    ekf = replace(WAY, x_m=WAY.x_m - 7.0, y_m=WAY.y_m + 3.0 * (np.arange(51) == 20) + 5.0)
    way = replace(WAY, x_m=WAY.x_m + 4.0, y_m=WAY.y_m - 9.0)
    anchors = checkpoints(np.array([T0_S + 11.2]), np.array([14.0]), np.array([-9.6]), source="anchors.csv")
    # the EKF knows nothing of frames: it is moved to where the smoothed walk begins
    loss = () if weight is None else (residuals("anchor", {20: weight}),)
    return hand_result(way, ekf, smoothed={"residuals": loss}, told=Told(anchors=anchors))


def test_anchors_are_told_with_what_they_did() -> None:
    (finding,) = told(anchored(), "anchor")
    assert finding.text == ("anchor at step 20: the smoothed walk is 0.6 m from it, the EKF, not told of it, 3.6 m")
    assert finding.start_s == finding.end_s == 11.0


def test_an_anchor_is_doubted_at_less_than_half_its_pull() -> None:
    assert texts(anchored(0.49), "anchor")[0].endswith(
        "3.6 m; doubted, the walk was pulled less than half as far as it asked"
    )
    assert texts(anchored(0.51), "anchor")[0].endswith("3.6 m")


def test_a_closed_walk_is_told_at_its_end() -> None:
    ekf = replace(WAY, y_m=0.1 * np.arange(51.0))
    for weight, ending in (
        (0.49, "25.5 m; doubted, the walk was pulled less than half as far as it asked"),
        (0.5, "m"),
    ):
        loss = (residuals("closed walk", {50: weight}),)
        (finding,) = told(hand_result(WAY, ekf, None, {"residuals": loss}, told=Told(closed_walk=True)), "closed_walk")
        assert finding.text.startswith("closed walk at step 50: the smoothed walk is 25.0 m from it, the EKF")
        assert finding.text.endswith(ending)
        assert finding.start_s == 26.0


CLOSURES = (Closure(5, 40, 1.0, 1.0), Closure(7, 38, 1.0, 1.0), Closure(9, 36, 1.0, 1.0))


def tied(higher_m: float = 0.0, weights: dict[int, float] | None = None) -> WalkResult:
    """Both passes 0.4 m apart as smoothed, 1.5 m by the EKF; the way back may lie higher."""
    back = np.arange(51) > 25
    x_m = np.where(back, 45.0 - np.arange(51), np.arange(51.0)) * 0.5
    way = replace(WAY, x_m=x_m, y_m=np.where(back, 0.4, 0.0), z_m=np.where(back, 5.0 + higher_m, 5.0))
    ekf = replace(way, y_m=np.where(back, 1.5, 0.0))
    loss = (residuals("closure", weights or {}),)
    return hand_result(way, ekf, smoothed={"residuals": loss, "closures": CLOSURES})


def test_closures_are_told_with_what_they_did() -> None:
    (finding,) = told(tied(weights={40: 0.49, 38: 0.5, 36: 0.1}), "closure")
    assert finding.text == (
        "the way back was tied to the way out at 3 places (2 doubted): both passes are 0.4 m apart as smoothed "
        "(median), 1.5 m by the EKF, which was not told"
    )
    assert (finding.start_s, finding.end_s) == (21.0, 19.0)  # of the first and last of them
    assert "(0 doubted)" in texts(tied(), "closure")[0]


def test_passes_half_a_metre_apart_in_height_are_told() -> None:
    assert texts(tied(0.49), "altitude") == []
    text = "by the barometer the way back lies {} m above the way out: its pressure drifted"
    assert texts(tied(0.56), "altitude") == [text.format("+0.6")]
    assert texts(tied(-0.56), "altitude") == [text.format("-0.6")]
    assert texts(tied(-0.49), "altitude") == []
    (finding,) = told(tied(0.56), "altitude")
    assert (finding.start_s, finding.end_s) == (21.0, 19.0)  # of the first and last of them


def truth(x_m: Sequence[float], y_m: Sequence[float], every_s: float = 2.0) -> Checkpoints:
    """Places every so often from the first step on, on the event clock."""
    t_s = T0_S + 1.0 + every_s * np.arange(float(len(x_m)))
    return checkpoints(t_s, np.array(x_m, dtype=np.float64), np.array(y_m, dtype=np.float64), source="truth.csv")


def known(places: Checkpoints, way: Trajectory = WAY, sigma_m: float = 0.4) -> list[str]:
    return texts(hand_result(with_cov(way, 0.1, sigma_m), told=Told(truth=places)), "truth")


def beside(off_m: float, wrong: int = 2, count: int = 12) -> Checkpoints:
    """Places passed every two metres; some but the first ``off_m`` to the side."""
    return truth([2.0 * i for i in range(count)], [off_m if 0 < i <= wrong else 0.0 for i in range(count)])


def test_a_tenth_of_the_checkpoints_beyond_two_sigma_is_told() -> None:
    text = "the smoothed walk is further from the truth than its 2σ at 2 of 11 checkpoints"
    assert known(beside(0.79)) == []
    assert text in known(beside(0.81))
    assert known(beside(0.81, wrong=1, count=10)) == [text.replace("2 of 11", "1 of 9")]
    assert known(beside(0.81, wrong=1, count=11)) == []  # one of ten is no more than a tenth


def test_checkpoints_are_not_surveyed_better_than_half_a_metre() -> None:
    assert known(beside(0.49), sigma_m=0.2) == []
    assert known(beside(0.51), sigma_m=0.2) != []


def test_the_first_checkpoint_is_where_the_walk_agrees() -> None:
    moved = truth([7.0 + 2.0 * i for i in range(12)], [-9.0] * 12)
    assert known(moved) == []


def test_the_survey_may_be_off_at_the_checkpoint_and_at_the_first() -> None:
    """Two sigma of 0.4 m of walk and 0.3 m of survey, twice: 1.17 m."""
    surveyed = [replace(beside(off_m), sigma_m=np.full(12, 0.3)) for off_m in (1.15, 1.19)]
    assert [len(known(places)) for places in surveyed] == [0, 1]
    assert len(known(beside(1.15))) == 1


def turned(by_deg: float, longer: float = 1.0) -> Checkpoints:
    """Truth of a walk that was smoothed turned to the left by so much, and so many times too long."""
    at = 4.0 / longer * np.arange(7.0) * np.exp(-1j * math.radians(by_deg))
    return truth(at.real.tolist(), at.imag.tolist(), 4.0)


def test_a_walk_turned_by_eight_degrees_is_told() -> None:
    text = "by the truth the smoothed walk is turned {} (median leg): how the device was held"
    assert known(turned(7.9), sigma_m=9.0) == known(turned(-7.9), sigma_m=9.0) == []
    assert known(turned(8.1), sigma_m=9.0)[0].startswith(text.format("8° to the left"))
    assert known(turned(-12.0), sigma_m=9.0)[0].startswith(text.format("12° to the right"))


def corner(by_deg: float, off_m: float = 0.0) -> Checkpoints:
    """Truth of a walk around a corner, turned to the left by so much, its middle place moved."""
    at = np.array([0.0, 8.0, 8.0 + 1j * off_m + 4j, 8.0 + 8j, 8.0 + 12j]) * np.exp(-1j * math.radians(by_deg))
    return truth(at.real.tolist(), at.imag.tolist(), 8.0)


def test_truth_in_another_frame_is_told_where_it_fits_once_turned() -> None:
    way = way_along((0.0, 0.0), (8.0, 0.0), (8.0, 12.0), dt_s=0.5, t0_s=1.0)
    slow = replace(way, t_s=1.0 + np.interp(way.distance_m, (0, 8, 12, 16, 20), (0, 8, 16, 24, 32)))
    text = "the smoothed walk is turned {} of the truth and fits it once turned back (RMSE "
    assert known(corner(25.0), slow, 90.0)[0].startswith(text.format("25° to the left"))
    assert known(corner(-120.0), slow, 90.0)[0].startswith(text.format("120° to the right"))
    assert "0.0 m aligned): truth in another frame" in known(corner(25.0), slow, 90.0)[0]
    assert len(known(corner(25.0), slow, 90.0)) == 1  # not told a second time by its median leg
    assert known(corner(19.0), slow, 90.0)[0].startswith("by the truth the smoothed walk is turned 19° to the left")
    assert "fits it" not in "".join(known(corner(25.0, off_m=5.0), slow, 90.0))


def test_a_walk_eight_per_cent_too_long_or_short_is_told() -> None:
    assert known(turned(0.0, 1.079), sigma_m=9.0) == known(turned(0.0, 0.921), sigma_m=9.0) == []
    assert len(known(turned(0.0, 1.083), sigma_m=9.0)) == len(known(turned(0.0, 0.917), sigma_m=9.0)) == 1
    assert known(turned(0.0, 1.1), sigma_m=9.0) == ["by the truth the smoothed walk is 10 % too long (median leg)"]
    assert known(turned(0.0, 0.88), sigma_m=9.0) == ["by the truth the smoothed walk is 12 % too short (median leg)"]


def test_truth_is_told_over_its_own_time_and_only_with_a_sigma() -> None:
    (finding,) = told(hand_result(with_cov(WAY, 9.0, 9.0), told=Told(truth=turned(20.0))), "truth")
    assert (finding.start_s, finding.end_s) == (1.0, 25.0)
    assert texts(hand_result(WAY, told=Told(truth=turned(20.0))), "truth") == []
    assert texts(hand_result(with_cov(WAY), told=Told(truth=truth([0.0], [0.0]))), "truth") == []
    assert known(truth([0.0, 1.0], [0.0, 0.0])) == [
        "the smoothed walk is further from the truth than its 2σ at 1 of 1 checkpoints"
    ]


def bias(values_deg_s: Any, sigma_deg_s: float | None = None) -> str:
    way = replace(WAY, gyro_bias_rad_s=np.radians(values_deg_s * EVERY))
    if sigma_deg_s is not None:
        way = replace(way, sigma_bias_rad_s=np.radians(changed(51, [50], sigma_deg_s, 9.0)))
    (finding,) = told(hand_result(way), "gyro_bias")
    assert finding.start_s == finding.end_s == 26.0
    return finding.text


def test_the_bias_is_told_with_how_it_moved() -> None:
    assert bias(0.2) == "gyroscope's bias by the smoother +0.20 °/s (2σ) at the end; the same all along"
    assert bias(-0.2, 0.06) == "gyroscope's bias by the smoother -0.20 ± 0.12 °/s (2σ) at the end; the same all along"
    ramp = np.linspace(-0.1, 0.3, 51)
    assert bias(ramp).endswith("+0.30 °/s (2σ) at the end; it moved between -0.10 and +0.30 °/s")


def test_a_hundredth_of_a_degree_a_second_is_a_move() -> None:
    assert bias(np.linspace(0.1, 0.1099, 51)).endswith("the same all along")
    assert bias(np.linspace(0.1, 0.1101, 51)).endswith("it moved between +0.10 and +0.11 °/s")


def test_of_each_kind_the_five_longest_are_told_in_order_of_time() -> None:
    doubted: dict[int, float] = {}
    for i, (first, count) in enumerate([(2, 3), (8, 2), (14, 4), (21, 5), (29, 2), (35, 3), (42, 4)]):
        doubted |= dict.fromkeys(range(first, first + count), 0.1 + 0.01 * i)
    found = told(compassed(doubted), "compass")
    assert [(f.start_s, f.end_s - f.start_s) for f in found] == [
        (1.5, 1.5),
        (7.5, 2.0),
        (11.0, 2.5),
        (18.0, 1.5),
        (21.5, 2.0),
    ]


def test_findings_of_all_kinds_are_in_order_of_time() -> None:
    columns: dict[str, Any] = {
        "frequency_hz": changed(51, slice(30, 34), 1.0, 2.0),
        "chained": [k != 10 for k in range(51)],
    }
    assert [f.kind for f in walk_findings(hand_result(WAY, steps=columns))] == ["gap", "steps", "gyro_bias"]
