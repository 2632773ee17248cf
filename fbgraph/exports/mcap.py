"""MCAP with Foxglove's Protobuf schemas, which Foxglove, Rerun and PlotJuggler read.

====================  ============================  ========================================================
topic                 schema                        what
====================  ============================  ========================================================
``/tf``               ``foxglove.FrameTransform``   ``walk`` to ``walker``, a message a breadcrumb
``/pose``             ``foxglove.PoseInFrame``      the same as a pose
``/odometry``         ``foxglove.Odometry``         the same with its 6 × 6 covariance, zero where unknown
``/path``             ``foxglove.PosesInFrame``     the whole walk, once
``/fix``              ``foxglove.LocationFix``      where a place on Earth is known
``/events``           ``foxglove.Log``              what the log marked
``/acc_m_s2``         ``foxglove.Vector3``          the log's samples, body frame; so ``/gyro_rad_s``, ``/mag_ut``
``/pressure_hpa``     ``google.protobuf.DoubleValue``
====================  ============================  ========================================================

``log_time`` is the log's event clock in nanoseconds.
"""

from __future__ import annotations

import heapq
import math
from collections.abc import Iterator
from typing import TYPE_CHECKING, Any, BinaryIO

import numpy as np

from fbgraph import __version__
from fbgraph.core.errors import DataError
from fbgraph.core.geometry import FloatArray, heading_deg
from fbgraph.core.safe_text import visible
from fbgraph.core.sensor_log import SensorLog
from fbgraph.core.trajectory import Trajectory
from fbgraph.exports.exported_walk import ExportedWalk
from fbgraph.run.log_again import read_log_again

if TYPE_CHECKING:
    from foxglove_schemas_protobuf.Pose_pb2 import Pose

DESCRIPTION = "poses, covariance, events and the log's sensors, for Foxglove, Rerun, PlotJuggler"
SUFFIX, BINARY, ON_EARTH = ".mcap", True, False
FRAME, BODY = "walk", "walker"
_SENSORS = {"acc": "/acc_m_s2", "gyro": "/gyro_rad_s", "mag": "/mag_ut", "pressure": "/pressure_hpa"}

Timed = Iterator[tuple[int, str, Any]]
"""(nanoseconds on the log's clock, topic, message), in order of time."""


def write(walk: ExportedWalk, out: BinaryIO) -> list[str]:
    """Write it; without the sensors, saying so, if the log cannot be read any more."""
    from mcap_protobuf.writer import Writer  # here, because only MCAP needs it

    log, notes = _log(walk)
    firsts_s = [float(walk.trajectory.t_s[0]), *(t_s for t_s, _ in walk.events)]
    if log is not None:
        firsts_s += [log.t0_s + float(stream.t_s[0]) for name in _SENSORS if len(stream := getattr(log, name))]
    later_s = max(0, -math.floor(min(firsts_s)))  # the file's times are unsigned
    if later_s:
        notes.append(f"the log's clock begins before zero: times are {later_s} s later than its")
    if not walk.dated:
        notes.append("the log's clock does not show the date: viewers will show one of 1970")
    streams = [_poses(walk), _path(walk), _events(walk)]
    if walk.placed is not None:
        streams.append(_fixes(walk))
        notes += [note for note in (walk.placed.note, *walk.heights_note) if note]
    if log is not None:
        streams += [_samples(log, name, topic) for name, topic in _SENSORS.items()]
    with Writer(out) as writer:
        about = {"fbgraph": __version__, "name": walk.name, "estimator": walk.estimator}
        about["caution"] = " ".join((*walk.caution, *notes))
        writer.add_metadata("fbgraph", {key: visible(text) for key, text in about.items()})
        for t_ns, topic, message in heapq.merge(*streams, key=lambda one: one[0]):
            time_ns = t_ns + later_s * 1_000_000_000
            if topic not in _SENSORS.values():  # those have no field for it
                message.timestamp.FromNanoseconds(time_ns)
            writer.write_message(topic, message, time_ns, time_ns)
    return notes


def _log(walk: ExportedWalk) -> tuple[SensorLog | None, list[str]]:
    """The log that the run was made from, or why its samples are left out."""
    try:
        log = read_log_again(walk.run, walk.log_path).log
    except DataError as error:
        return None, [f"without the sensors: {error}"]
    noted = walk.run.summary["log"]
    samples = {name: len(getattr(log, name)) for name in _SENSORS}
    if abs(log.t0_s - noted["t0_s"]) > 1e-6 or noted.get("samples", samples) != samples:
        return None, [f"without the sensors: {walk.run.folder}: its log is not what it was when the run was made"]
    return log, []


def _ns(t_s: FloatArray) -> list[int]:
    """Seconds as nanoseconds, to a microsecond, which is what the files of a run hold."""
    ticks: list[int] = np.round(t_s * 1e6).astype(np.int64).tolist()
    return [tick * 1000 for tick in ticks]


def _pose(x_m: float, y_m: float, z_m: float, yaw_rad: float) -> Pose:
    from foxglove_schemas_protobuf.Pose_pb2 import Pose
    from foxglove_schemas_protobuf.Quaternion_pb2 import Quaternion
    from foxglove_schemas_protobuf.Vector3_pb2 import Vector3

    turn = Quaternion(x=0.0, y=0.0, z=math.sin(yaw_rad / 2.0), w=math.cos(yaw_rad / 2.0))
    return Pose(position=Vector3(x=x_m, y=y_m, z=z_m), orientation=turn)


def _rows(way: Trajectory) -> list[tuple[float, float, float, float]]:
    return list(zip(way.x_m.tolist(), way.y_m.tolist(), way.z_m.tolist(), way.yaw_rad.tolist(), strict=True))


def _poses(walk: ExportedWalk) -> Timed:
    from foxglove_schemas_protobuf.FrameTransform_pb2 import FrameTransform
    from foxglove_schemas_protobuf.Odometry_pb2 import Odometry
    from foxglove_schemas_protobuf.PoseInFrame_pb2 import PoseInFrame

    cov = _covariance(walk.trajectory)
    for t_ns, row, unsure in zip(_ns(walk.trajectory.t_s), _rows(walk.trajectory), cov.tolist(), strict=True):
        pose = _pose(*row)
        moved = FrameTransform(
            parent_frame_id=FRAME, child_frame_id=BODY, translation=pose.position, rotation=pose.orientation
        )
        told = Odometry(frame_id=FRAME, body_frame_id=BODY, pose=pose, pose_covariance=unsure)
        yield t_ns, "/tf", moved
        yield t_ns, "/pose", PoseInFrame(frame_id=FRAME, pose=pose)
        yield t_ns, "/odometry", told


def _covariance(way: Trajectory) -> FloatArray:
    """(K+1, 36) of x, y, z, and rotations about them, row-major; zero where unknown, as the schema wants it."""
    full = np.zeros((len(way), 6, 6))
    if way.cov_xy_yaw is not None:
        full[:, :2, :2] = way.cov_xy_yaw[:, :2, :2]
        full[:, :2, 5] = full[:, 5, :2] = way.cov_xy_yaw[:, :2, 2]
        full[:, 5, 5] = way.cov_xy_yaw[:, 2, 2]
    if way.sigma_z_m is not None:
        full[:, 2, 2] = way.sigma_z_m**2
    return np.nan_to_num(full, nan=0.0).reshape(len(way), 36)


def _path(walk: ExportedWalk) -> Timed:
    from foxglove_schemas_protobuf.PosesInFrame_pb2 import PosesInFrame

    first_ns = _ns(walk.trajectory.t_s)[0]
    path = PosesInFrame(frame_id=FRAME, poses=[_pose(*row) for row in _rows(walk.trajectory)])
    yield first_ns, "/path", path


def _events(walk: ExportedWalk) -> Timed:
    from foxglove_schemas_protobuf.Log_pb2 import Log

    for t_s, label in sorted(walk.events):
        (t_ns,) = _ns(np.array([t_s]))
        event = Log(level=Log.INFO, message=visible(label), name="event")
        yield t_ns, "/events", event


def _fixes(walk: ExportedWalk) -> Timed:
    from foxglove_schemas_protobuf.LocationFix_pb2 import LocationFix

    origin, way = walk.on_map
    heights_m = walk.heights_m
    heights = [0.0] * len(way) if heights_m is None else heights_m.tolist()
    cov = _covariance(way).reshape(-1, 6, 6)[:, :3, :3].reshape(-1, 9)
    known = LocationFix.KNOWN if cov.any() else LocationFix.UNKNOWN
    lat_lon = origin.geodetic_deg(way.xy_m).tolist()
    rows = zip(_ns(way.t_s), lat_lon, heights, cov.tolist(), way.yaw_rad.tolist(), strict=True)
    for t_ns, (lat_deg, lon_deg), height_m, unsure, yaw_rad in rows:
        fix = LocationFix(
            frame_id=BODY,
            latitude=lat_deg,
            longitude=lon_deg,
            altitude=height_m,
            position_covariance=unsure,
            position_covariance_type=known,
            heading=math.radians(heading_deg(yaw_rad)),
        )
        yield t_ns, "/fix", fix


def _samples(log: SensorLog, name: str, topic: str) -> Timed:
    from foxglove_schemas_protobuf.Vector3_pb2 import Vector3
    from google.protobuf.wrappers_pb2 import DoubleValue

    stream = getattr(log, name)
    for t_ns, row in zip(_ns(stream.t_s + log.t0_s), stream.values.tolist(), strict=True):
        yield t_ns, topic, Vector3(x=row[0], y=row[1], z=row[2]) if len(row) == 3 else DoubleValue(value=row[0])
