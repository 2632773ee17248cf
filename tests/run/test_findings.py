"""What explains a walk beyond its trajectory: findings, lanes, where on Earth it was."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from fbgraph.core.aids import Told
from fbgraph.core.checkpoints import checkpoints
from fbgraph.core.config import load_config
from fbgraph.core.georeference import Georeference
from fbgraph.core.sensor_log import SensorLog, Stream
from fbgraph.front_end.step_track import StepTrack
from fbgraph.pipeline import reconstruct
from fbgraph.run.finding import Finding
from fbgraph.run.findings import walk_findings
from fbgraph.run.timeline_lanes import (
    DOUBTED,
    STANDING,
    WALKING,
    compass_lane,
    compass_trust,
    places_lane,
    stretches,
    wearer_lane,
)
from fbgraph.run.walk_result import WalkResult
from fbgraph.simulator.gait import Walker
from fbgraph.simulator.routes import load_route
from fbgraph.simulator.simulate import SimulatedWalk, simulate
from fbgraph.simulator.simulate_options import SimulateOptions

NUREMBERG = Georeference(49.4613, 11.1110)


@pytest.fixture(scope="module")
def clean() -> SimulatedWalk:
    options = SimulateOptions(walker=Walker(gait_variation=0.0), noise=0.3, anomalies=0.0)
    return simulate(load_route("out-and-back", 2.0), options, seed=1)


def smoothed(log: SensorLog) -> WalkResult:
    return reconstruct(log, load_config("m5stickc"))


@pytest.fixture(scope="module")
def undisturbed(clean: SimulatedWalk) -> WalkResult:
    return smoothed(clean.log)


def told_of(result: WalkResult, kind: str) -> list[Finding]:
    return [finding for finding in walk_findings(result) if finding.kind == kind]


def test_a_magnet_is_found_where_and_when_it_was(clean: SimulatedWalk, undisturbed: WalkResult) -> None:
    """A magnet carried past the device for six seconds: that stretch is told, and no other."""
    start_s = undisturbed.track.t_s[len(undisturbed.track) // 4]
    mag = clean.log.mag
    near = (mag.t_s >= start_s) & (mag.t_s < start_s + 6.0)
    turned = mag.values + near[:, None] * np.array((60.0, 40.0, 30.0))
    result = smoothed(replace(clean.log, mag=Stream(mag.t_s, turned)))
    told = told_of(result, "compass")
    assert len(told) == 1
    assert abs(told[0].start_s - start_s) < 1.5
    assert abs(told[0].end_s - (start_s + 6.0)) < 1.5
    assert "µT" in told[0].text
    during = (result.track.t_s > start_s + 1.0) & (result.track.t_s < start_s + 5.0)
    assert (compass_trust(result)[during] < 0.5).all()
    lane = compass_lane(result)
    assert [state for _, state in lane].count(DOUBTED) == 1
    assert not told_of(undisturbed, "compass")


def test_steps_that_were_missed_are_told(undisturbed: WalkResult) -> None:
    """Every second step taken away over ten metres: half the frequency, and somebody says so."""
    track = undisturbed.track
    slow = [
        replace(step, frequency_hz=step.frequency_hz / 2.0) if 20 <= k < 30 else step
        for k, step in enumerate(track.steps)
    ]
    result = replace(undisturbed, track=StepTrack(slow))
    (told,) = told_of(result, "steps")
    assert "steps 20 to 29 much slower" in told.text
    assert told.start_s == pytest.approx(track.start_s[20])
    assert not told_of(undisturbed, "steps")


def test_the_wearer_walks_where_the_steps_are_and_stands_where_he_rested(undisturbed: WalkResult) -> None:
    lane = wearer_lane(undisturbed.signals, undisturbed.track, 1.5)
    assert lane[0][1] == STANDING
    ends = [t_s for t_s, _ in lane[1:]] + [math.inf]
    for k in range(1, len(undisturbed.track)):
        at_s = undisturbed.track.t_s[k] - 0.1
        state = next(name for (start_s, name), end_s in zip(lane, ends, strict=True) if start_s <= at_s < end_s)
        assert state == WALKING, k


def test_doubted_places_are_told_with_how_far(clean: SimulatedWalk) -> None:
    walk = checkpoints(clean.t_s[::1500], clean.x_m[::1500], clean.y_m[::1500])
    wrong = replace(walk, x_m=walk.x_m + np.where(np.arange(len(walk)) == 2, 25.0, 0.0))
    result = reconstruct(clean.log, load_config("m5stickc"), Told(anchors=wrong.since(-clean.log.t0_s)))
    told = told_of(result, "anchor")
    assert len(told) == min(len(walk), 5)
    doubted = [finding for finding in told if "doubted" in finding.text]
    assert len(doubted) == 1
    assert doubted[0].start_s == pytest.approx(walk.t_s[2], abs=1.0)
    assert [state for _, state in places_lane(result)].count("anchor") == len(walk)


def test_what_only_truth_can_tell(clean: SimulatedWalk, undisturbed: WalkResult) -> None:
    """A walk turned by 20° and stretched by 15 %: said so, and that it is less sure than it claims."""
    moved = 1.0 / 1.15 * (clean.x_m + 1j * clean.y_m) * np.exp(-1j * np.radians(20.0))
    known = slice(None, None, 1000)
    t_s = clean.t_s[known] + clean.log.t0_s
    truth = checkpoints(t_s, moved.real[known], moved.imag[known])
    told = " ".join(
        finding.text for finding in walk_findings(replace(undisturbed, told=Told(truth))) if finding.kind == "truth"
    )
    assert "further from the truth than its 2σ" in told
    assert "to the left" in told
    assert "% too long" in told
    honest = checkpoints(t_s, clean.x_m[known], clean.y_m[known])
    assert not [
        finding for finding in walk_findings(replace(undisturbed, told=Told(honest))) if finding.kind == "truth"
    ]


def test_stretches_bridge_short_breaks_and_drop_short_runs() -> None:
    flags = np.zeros(30, dtype=bool)
    flags[[3, 4, 5, 7, 8, 20]] = True
    assert stretches(flags) == [(3, 8)]
    assert stretches(np.zeros(5, dtype=bool)) == []


def test_the_walk_lies_where_its_user_anchors_or_truth_say(clean: SimulatedWalk, undisturbed: WalkResult) -> None:
    t_s = clean.t_s[::1500] + clean.log.t0_s
    places = checkpoints(t_s, clean.x_m[::1500] + 50.0, clean.y_m[::1500] - 20.0, georeference=NUREMBERG)
    assert undisturbed.georeference is None
    by_user = replace(undisturbed, told=Told(places, origin=NUREMBERG)).georeference
    assert by_user is not None
    assert (by_user.lat_deg, by_user.lon_deg) == pytest.approx((NUREMBERG.lat_deg, NUREMBERG.lon_deg), abs=1e-9)
    by_truth = replace(undisturbed, told=Told(places)).georeference
    assert by_truth is not None
    np.testing.assert_allclose(
        NUREMBERG.local_m(np.array([[by_truth.lat_deg, by_truth.lon_deg]])), [[50, -20]], atol=1.0
    )
    anchored = reconstruct(clean.log, load_config("m5stickc"), Told(anchors=places))
    where = anchored.georeference  # the world is the anchors' frame
    assert where is not None
    assert (where.lat_deg, where.lon_deg) == pytest.approx((NUREMBERG.lat_deg, NUREMBERG.lon_deg), abs=1e-9)
    told = replace(anchored, told=Told(anchors=places, origin=NUREMBERG)).georeference
    assert told is not None
    (start,) = told.geodetic_deg(anchored.smoothed.trajectory.xy_m[:1])
    np.testing.assert_allclose(start, (NUREMBERG.lat_deg, NUREMBERG.lon_deg), atol=1e-8)
