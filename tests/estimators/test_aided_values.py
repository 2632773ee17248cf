"""What becomes of aids: closed ends that are none, anchors that contradict, and the covariance in their frame."""

import math
from dataclasses import replace

import gtsam
import numpy as np
import pytest
from gtsam.symbol_shorthand import F, X
from support.by_hand import steps_of, way_along

from fbgraph.core.aids import Aids, AnchorFrame
from fbgraph.core.checkpoints import Checkpoints, checkpoints
from fbgraph.core.config import GraphConfig
from fbgraph.core.geometry import FloatArray, turned
from fbgraph.core.trajectory import Trajectory
from fbgraph.estimators.aided import CheckedAids, check_aids, in_anchors_frame, in_walks_frame
from fbgraph.front_end.step_track import StepTrack

CONFIG = GraphConfig()
LOOP = way_along((0.0, 0.0), (40.0, 0.0), (40.0, 30.0), (0.0, 30.0), (0.0, 3.0))
AT = np.array([4, 60, 100, 160, 200, 230])


def sure(way: Trajectory, sigma_m: float = 1.0) -> Trajectory:
    cov = np.zeros((len(way), 3, 3))
    cov[:, 0, 0] = cov[:, 1, 1] = sigma_m**2
    cov[:, 2, 2] = 0.05**2
    return replace(way, cov_xy_yaw=cov)


def checked(aids: Aids, way: Trajectory = LOOP) -> CheckedAids:
    track = StepTrack(steps_of(way, yaw_mag_rad=way.yaw_rad.tolist()))
    return check_aids(aids, track, sure(way), CONFIG)


def anchors_at(places_m: FloatArray, at: FloatArray = AT) -> Checkpoints:
    return checkpoints(LOOP.t_s[at], places_m[:, 0], places_m[:, 1])


def test_a_closed_walk_may_end_some_metres_off() -> None:
    found = checked(Aids(closed_walk=True))
    assert found.aids.closed_walk
    assert found.doubts == ()


def test_a_closed_walk_that_ends_elsewhere_is_none() -> None:
    found = checked(Aids(closed_walk=True), way_along((0.0, 0.0), (40.0, 0.0), (40.0, 30.0), (0.0, 30.0)))
    assert not found.aids.closed_walk
    (reason,) = found.doubts
    # 30 m at hypot(1, 1) m
    assert reason.text.startswith("closed walk: the sensors put the end 30 m away from the start (21 sigma): doubted")
    assert (reason.kind, reason.weight > 1.0) == ("closed_walk", True)


def test_good_anchors_are_believed_as_they_are() -> None:
    told = anchors_at(LOOP.xy_m[AT] + (1e6, -1e6))
    found = checked(Aids(told))
    assert found.aids.anchors is told
    assert (found.doubts, found.notes) == ((), ())
    assert found.aids.frame is not None
    assert found.aids.frame.free
    assert found.aids.frame.turn_rad == pytest.approx(0.0, abs=0.01)


def test_a_turned_frame_is_noted_with_the_side_of_its_axis() -> None:
    found = checked(Aids(anchors_at(turned(LOOP.xy_m[AT], math.radians(30.0)))))
    assert found.doubts == ()
    (note,) = found.notes
    assert note.startswith("the anchors' frame is turned by 30 ±")
    assert "its y axis to the East" in note
    assert found.aids.frame is not None
    assert found.aids.frame.turn_rad == pytest.approx(math.radians(-30.0), abs=0.01)


def test_a_wrong_anchor_is_as_unsure_as_it_is_wrong() -> None:
    places = LOOP.xy_m[AT].copy()
    places[2] += (0.0, 24.0)
    found = checked(Aids(anchors_at(places)))
    assert found.aids.anchors is not None
    sigma_m = found.aids.anchors.sigma_m
    assert sigma_m[2] == pytest.approx(24.0, abs=0.5)
    assert np.isnan(np.delete(sigma_m, 2)).all()
    (reason,) = found.doubts
    assert reason.text.startswith("1 of 6 anchors contradict the sensors by up to 24 m (at 50 s")
    assert (reason.start_s, reason.end_s) == (LOOP.t_s[100], LOOP.t_s[100])


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (lambda xy: xy[:, ::-1], "with x and y exchanged they would fit"),
        (lambda xy: xy * (-1.0, 1.0), "with x counted to the West they would fit"),
        (lambda xy: xy * (1.0, -1.0), "with y counted to the South they would fit"),
        (lambda xy: xy * 3.2808, "with feet instead of metres they would fit"),
        (lambda xy: xy * 1e-3, "with kilometres instead of metres they would fit"),
        (lambda xy: xy[:, ::-1] * 1e3, "with x and y exchanged and millimetres instead of metres they would fit"),
    ],
)
def test_a_frame_that_is_wrong_is_named_and_bends_nothing(change: object, words: str) -> None:
    assert callable(change)
    found = checked(Aids(anchors_at(change(LOOP.xy_m[AT]))))
    (reason,) = found.doubts
    assert words in reason.advice
    assert found.aids.anchors is not None
    assert found.aids.anchors.sigma_m.min() > 10.0
    assert found.aids.frame is not None
    assert not found.aids.frame.free


def test_latitude_exchanged_with_longitude_is_named() -> None:
    east, north = LOOP.xy_m[AT].T
    lat_deg, lon_deg = 47.0 + north / 111_200.0, 8.0 + east / (111_200.0 * math.cos(math.radians(47.0)))
    place = checkpoints(LOOP.t_s[AT], east, north).georeference
    assert place is None
    from fbgraph.core.georeference import Georeference

    first = Georeference(float(lon_deg[0]), float(lat_deg[0]))
    x_m, y_m = first.local_m(np.column_stack((lon_deg, lat_deg))).T
    found = checked(Aids(checkpoints(LOOP.t_s[AT], x_m, y_m, georeference=first)))
    (reason,) = found.doubts
    assert "latitude and longitude exchanged" in reason.advice or "x and y exchanged" in reason.advice


def test_a_late_clock_is_told_and_set_right() -> None:
    later = np.column_stack([np.interp(LOOP.t_s[AT] - 4.0, LOOP.t_s, c) for c in (LOOP.x_m, LOOP.y_m)])
    found = checked(Aids(anchors_at(later)))
    (reason,) = found.doubts
    assert "they fit if all of them are 4 s too late" in reason.text
    assert found.aids.anchors is not None
    assert found.aids.anchors.t_s == pytest.approx(LOOP.t_s[AT] - 4.0)


def test_anchors_side_by_side_tell_no_turn() -> None:
    at = np.array([50, 53])
    found = checked(Aids(anchors_at(LOOP.xy_m[at], at)))
    assert found.notes == ("the anchors are too near to one another to tell how their frame is turned",)
    assert found.aids.frame is None


def test_a_walk_seen_from_its_anchors_frame_and_back() -> None:
    frame = AnchorFrame(3.0, -2.0, 0.4, (1e5, 2e5), free=True)
    away = in_walks_frame(LOOP, frame)
    assert (away.x_m[0], away.y_m[0]) == pytest.approx(turned(np.array((-1e5, -2e5)), 0.4) + np.array((3.0, -2.0)))
    assert away.yaw_rad[0] == pytest.approx(LOOP.yaw_rad[0] + 0.4)


def test_the_covariance_in_the_anchors_frame_is_that_of_the_difference() -> None:
    """A breadcrumb and a frame, both known by priors: what the one is as seen from the other."""
    graph, values = gtsam.NonlinearFactorGraph(), gtsam.Values()
    poses = {F(0): gtsam.Pose2(1.0, 2.0, 0.5), X(0): gtsam.Pose2(4.0, 6.0, 1.1), X(1): gtsam.Pose2(9.0, 3.0, -0.3)}
    for key, pose in poses.items():
        values.insert(key, pose)
        graph.push_back(gtsam.PriorFactorPose2(key, pose, gtsam.noiseModel.Diagonal.Sigmas(np.array([0.3, 0.2, 0.1]))))
    tie = gtsam.noiseModel.Diagonal.Sigmas(np.array([0.1, 0.4, 0.2]))
    graph.push_back(gtsam.BetweenFactorPose2(F(0), X(1), poses[F(0)].between(poses[X(1)]), tie))
    marginals = gtsam.Marginals(graph, values)
    xy = np.array([[poses[X(k)].x(), poses[X(k)].y()] for k in (0, 1)])
    yaw = np.array([poses[X(k)].theta() for k in (0, 1)])
    own = []
    for k in (0, 1):
        turn = np.eye(3)
        turn[:2, :2] = poses[X(k)].rotation().matrix()
        own.append(turn @ marginals.marginalCovariance(X(k)) @ turn.T)
    zeros = np.zeros(2)
    walk = Trajectory(np.array([0.0, 1e9]), xy[:, 0], xy[:, 1], zeros, yaw, zeros, cov_xy_yaw=np.array(own))
    frame = AnchorFrame(1.0, 2.0, 0.5, (100.0, 0.0), free=True)
    seen = in_anchors_frame(walk, graph, values, frame)
    for k in (0, 1):
        place = poses[F(0)].between(poses[X(k)])
        assert (seen.x_m[k] - 100.0, seen.y_m[k], seen.yaw_rad[k]) == pytest.approx(
            (place.x(), place.y(), place.theta())
        )
        # the difference's covariance by GTSAM's own joint marginal and Jacobians
        joint = marginals.jointMarginalCovariance([F(0), X(k)])
        both = np.block([[joint.at(a, b) for b in (F(0), X(k))] for a in (F(0), X(k))])
        by_frame, by_crumb = np.zeros((3, 3), order="F"), np.zeros((3, 3), order="F")
        poses[F(0)].between(poses[X(k)], by_frame, by_crumb)
        slope = np.hstack((by_frame, by_crumb))
        turn = np.eye(3)
        turn[:2, :2] = place.rotation().matrix()
        assert seen.cov_xy_yaw is not None
        assert seen.cov_xy_yaw[k] == pytest.approx(turn @ slope @ both @ slope.T @ turn.T, abs=1e-5)
