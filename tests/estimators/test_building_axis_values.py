"""A walk laid along its building's corridors: turned as it must be, refused where its legs say otherwise."""

import math
from dataclasses import replace

import numpy as np
import pytest
from support.by_hand import steps_of, way_along

from fbgraph.core.aids import Aids, WalkAxis
from fbgraph.core.checkpoints import checkpoints
from fbgraph.core.config import GraphConfig
from fbgraph.core.geometry import FloatArray, turned
from fbgraph.core.trajectory import Trajectory
from fbgraph.estimators.building_axis import OFFSETS_RAD, Legs, fit_axis, lay_along_axis, straight_legs
from fbgraph.estimators.estimates import Smoothed
from fbgraph.front_end.step_track import StepTrack

CONFIG = GraphConfig()
ROUND = way_along((0.0, 0.0), (40.0, 0.0), (40.0, 20.0), (10.0, 20.0), (10.0, 50.0))
ACROSS = way_along((0.0, 0.0), (30.0, 0.0), (30.0, 20.0), (46.0, 32.0), (46.0, 52.0), (20.0, 52.0))


def bowed(count: int = 120, radius_m: float = 25.0) -> Trajectory:
    """A path round a pond: nothing in it is straight."""
    yaw = np.cumsum(np.full(count, 0.5 / radius_m))
    x_m, y_m = np.cumsum(0.5 * np.cos(yaw)), np.cumsum(0.5 * np.sin(yaw))
    return Trajectory(np.linspace(0.0, 0.5 * (count - 1), count), x_m, y_m, 0.0 * yaw, yaw, 0.0 * yaw)


def off_by(way: Trajectory, degrees: float) -> Trajectory:
    """The same walk, its heading off all along."""
    xy_m = turned(way.xy_m - way.xy_m[0], math.radians(degrees)) + way.xy_m[0]
    return replace(way, x_m=xy_m[:, 0], y_m=xy_m[:, 1], yaw_rad=way.yaw_rad + math.radians(degrees))


def sure(way: Trajectory) -> Trajectory:
    """With the covariance of a walk of which only the mount is not known, and a metre of it."""
    r = way.xy_m - way.xy_m[0]
    swung = np.column_stack((-r[:, 1], r[:, 0], np.ones(len(way))))
    cov = CONFIG.sigma_mount_rad**2 * swung[:, :, None] * swung[:, None, :]
    return replace(way, cov_xy_yaw=cov + np.diag([1.0, 1.0, 0.01]))


def laid(way: Trajectory, axis_deg: float, sigma_deg: float = 2.0, aids: Aids | None = None) -> Smoothed:
    axis = WalkAxis(math.radians(axis_deg), math.radians(sigma_deg))
    smoothed = Smoothed(sure(way), errors=np.zeros(1), factors=0, residuals=())
    track = StepTrack(steps_of(way, yaw_mag_rad=way.yaw_rad.tolist()))
    return lay_along_axis(smoothed, track, replace(aids or Aids(), axis=axis), CONFIG)


def turned_deg(found: Smoothed) -> float:
    assert found.axis is not None
    return math.degrees(found.axis.turned_rad)


def test_the_straight_legs_of_a_walk() -> None:
    legs = straight_legs(ROUND)
    assert np.degrees(legs.yaw_rad) == pytest.approx([0.0, 90.0, 180.0, 90.0], abs=0.5)
    assert legs.length_m == pytest.approx([40.0, 20.0, 30.0, 30.0], abs=1.0)
    assert legs.last.tolist()[-1] == len(ROUND) - 1
    assert legs.counts == pytest.approx([3.0, 2.0, 3.0, 3.0], abs=0.1)  # no leg more than three times


def test_what_bends_or_is_short_is_no_straight_leg() -> None:
    for count in (60, 120, 200):
        assert len(straight_legs(bowed(count)).yaw_rad) == 0
    assert len(straight_legs(way_along((0.0, 0.0), (3.5, 0.0), (3.5, 3.5))).yaw_rad) == 0
    assert len(straight_legs(way_along((0.0, 0.0), (4.5, 0.0))).yaw_rad) == 1


def test_a_way_that_bends_is_straight_by_chance() -> None:
    """A straight piece counts if the straight ones are 40 % of the way."""
    curve = bowed(120)
    for straight_m, told in ((12.0, False), (45.0, True)):
        count = round(straight_m / 0.5)
        x_m = np.concatenate((np.arange(-float(count), 0.0) * 0.5, curve.x_m - curve.x_m[0]))
        y_m = np.concatenate((np.zeros(count), curve.y_m - curve.y_m[0]))
        yaw_rad = np.concatenate((np.zeros(count), curve.yaw_rad))
        way = Trajectory(np.arange(0.0, 0.5 * len(x_m), 0.5), x_m, y_m, 0.0 * x_m, yaw_rad, 0.0 * x_m)
        legs = straight_legs(way)
        assert bool(len(legs.yaw_rad)) is told
    assert legs.length_m[0] == pytest.approx(45.0, abs=7.0)


@pytest.mark.parametrize("off_deg", [-5.0, -2.0, 0.0, 3.0, 5.0])
def test_a_walk_is_turned_to_its_corridors(off_deg: float) -> None:
    found = laid(off_by(ROUND, off_deg), axis_deg=0.0)
    # what the legs ask, times what of it is the walk's and what the axis's, and what their own scatter leaves of it
    share = 6.0**2 / (6.0**2 + 2.0**2)
    legs_deg = 8.0 / math.sqrt(11.0)
    prior_deg = math.degrees(math.hypot(CONFIG.sigma_mount_rad, math.radians(2.0)))
    assert turned_deg(found) == pytest.approx(-off_deg * share * prior_deg**2 / (prior_deg**2 + legs_deg**2), abs=0.25)
    assert found.axis is not None
    assert (found.axis.used, found.axis.legs, found.axis.along, found.axis.why) == (True, 4, 4, "")
    assert np.allclose(found.trajectory.xy_m, off_by(off_by(ROUND, off_deg), turned_deg(found)).xy_m)
    assert (found.doubts, found.notes) == ((), ())


@pytest.mark.parametrize("by_deg", [17.0, 90.0, 181.0, -33.0])
def test_a_building_may_stand_any_way(by_deg: float) -> None:
    here, there = laid(off_by(ROUND, 4.0), 0.0), laid(off_by(ROUND, 4.0 + by_deg), by_deg)
    assert turned_deg(there) == pytest.approx(turned_deg(here), abs=0.05)
    assert there.trajectory.xy_m == pytest.approx(turned(here.trajectory.xy_m, math.radians(by_deg)), abs=0.1)


def test_a_hall_crossed_diagonally_turns_with_the_rest() -> None:
    found = laid(off_by(ACROSS, 4.0), 0.0)
    assert found.axis is not None
    assert (found.axis.used, found.axis.legs, found.axis.along) == (True, 5, 4)
    (table,) = found.residuals
    assert table.name == "axis"
    assert table.weight.argmin() == 2
    assert table.weight[2] < 0.01
    assert abs(np.degrees(8.0) * table.whitened[2] / np.degrees(1.0)) > 30.0  # degrees it lies off
    without = laid(off_by(way_along((0.0, 0.0), (30.0, 0.0), (30.0, 20.0), (30.0, 52.0), (4.0, 52.0)), 4.0), 0.0)
    assert turned_deg(found) == pytest.approx(turned_deg(without), abs=0.4)


@pytest.mark.parametrize("off_deg", [12.0, -15.0, 40.0])
def test_an_axis_that_the_legs_contradict_is_refused(off_deg: float) -> None:
    found = laid(ROUND, off_deg)
    assert found.axis is not None
    assert not found.axis.used
    assert np.array_equal(found.trajectory.xy_m, ROUND.xy_m)
    (reason,) = found.doubts
    assert (reason.kind, reason.weight >= 1.0) == ("axis", True)
    side = "right" if off_deg > 0 else "left"
    assert f"axis was not used: the walk's 4 straight legs lie {abs(off_deg):.0f}° to the {side} of it" in reason.text
    assert found.residuals == ()


def test_legs_that_tell_too_little_are_no_contradiction() -> None:
    short = way_along((0.0, 0.0), (5.0, 0.0))
    found = laid(off_by(short, 5.0), 0.0)
    assert found.axis is not None
    assert (found.axis.used, found.doubts) == (False, ())
    assert found.notes == ("the building's axis was not used: the walk's only straight leg tells too little",)


def test_a_walk_without_straight_legs_is_left_alone() -> None:
    found = laid(bowed(60), 0.0)
    assert found.notes == ("the building's axis was not used: too little of the walk is straight for 4 m or more",)
    assert found.doubts == ()


def test_without_a_compass_no_right_angle_is_the_right_one() -> None:
    track = StepTrack(steps_of(ROUND, yaw_mag_rad=np.full(len(ROUND), np.nan)))
    smoothed = Smoothed(ROUND, errors=np.zeros(1), factors=0, residuals=())
    found = lay_along_axis(smoothed, track, Aids(axis=WalkAxis(0.0, 0.03)), CONFIG)
    assert found.axis is not None
    assert "without a compass" in found.axis.why


def test_anchors_know_the_direction_better() -> None:
    two = checkpoints(ROUND.t_s[[0, 60]], ROUND.x_m[[0, 60]], ROUND.y_m[[0, 60]])
    assert "anchors tell" in laid(ROUND, 4.0, aids=Aids(two)).notes[0]
    one = checkpoints(ROUND.t_s[[60]], ROUND.x_m[[60]], ROUND.y_m[[60]])
    found = laid(ROUND, 4.0, aids=Aids(one))
    assert found.axis is not None
    assert found.axis.used
    assert found.trajectory.xy_m[60] == pytest.approx(ROUND.xy_m[60], abs=1e-9)  # turned about it


def test_nobody_named_a_building() -> None:
    smoothed = Smoothed(ROUND, errors=np.zeros(1), factors=0, residuals=())
    assert lay_along_axis(smoothed, StepTrack(steps_of(ROUND)), Aids(), CONFIG) is smoothed


def test_the_covariance_is_turned_and_as_narrow_as_the_axis_is_known() -> None:
    found = laid(off_by(ROUND, 3.0), 0.0)
    cov, fit = found.trajectory.cov_xy_yaw, found.axis
    assert cov is not None
    assert fit is not None
    r = found.trajectory.xy_m[-1] - found.trajectory.xy_m[0]
    across_m = float(np.hypot(*r))
    aside = np.array([-r[1], r[0]]) / across_m
    assert float(aside @ cov[-1, :2, :2] @ aside) == pytest.approx(1.0 + (fit.sigma_rad * across_m) ** 2)
    assert cov[-1, 2, 2] == pytest.approx(0.01 + fit.sigma_rad**2)
    assert fit.sigma_rad < CONFIG.sigma_mount_rad
    assert np.linalg.eigvalsh(cov).min() > 0.0


def test_what_is_left_is_what_legs_and_axis_leave() -> None:
    """The mean and deviation of a product of normals: the prior's, the legs' and what the axis may be off."""
    legs = Legs(np.radians([2.0, 92.0, 182.0]), np.full(3, 30.0), np.arange(3))
    for sigma_deg in (0.5, 3.0):
        fit = fit_axis(legs, WalkAxis(0.0, math.radians(sigma_deg)), CONFIG)
        own, prior = 8.0 / 3.0, math.hypot(math.degrees(CONFIG.sigma_mount_rad), sigma_deg)
        asked, var = (1.0 / (1.0 + (own / prior) ** 2) * -2.0), 1.0 / (1.0 / prior**2 + 1.0 / own**2)
        share = 6.0**2 / (6.0**2 + sigma_deg**2)
        assert math.degrees(fit.turned_rad) == pytest.approx(share * asked, abs=0.1)
        assert math.degrees(fit.sigma_rad) == pytest.approx(
            math.hypot(share * math.sqrt(var), math.sqrt(share) * sigma_deg), abs=0.1
        )


def test_an_axis_anywhere_is_the_measure() -> None:
    """Evidence against the mean over all axes: of no legs at all both are the same."""
    none: FloatArray = np.empty(0)
    fit = fit_axis(Legs(none, none, none.astype(np.int64)), WalkAxis(0.0, 0.03), CONFIG)
    assert fit.log_odds == pytest.approx(0.0, abs=1e-6)
    assert OFFSETS_RAD[[0, -1]] == pytest.approx([-math.pi / 4, math.pi / 4 - math.radians(0.5)])
