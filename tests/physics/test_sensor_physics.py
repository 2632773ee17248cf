"""Units, handedness and axes by physics: a device that turns in closed form, and real logs with planted errors."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from fbgraph.core.geometry import FloatArray
from fbgraph.core.sensor_log import Stream
from fbgraph.physics.judge_sensors import judge_sensors
from fbgraph.physics.judgement import Judged
from fbgraph.physics.sensor_axes import CHIPS, told_axes
from fbgraph.physics.sensor_units import judge_accelerometer, judge_pressure
from fbgraph.physics.turning import SIGNED_ORDERS, cut, integrate
from fbgraph.readers import read_log

G = 9.80665
NAMED = {"acc": 1.0, "gyro": 1.0, "mag": 1.0, "pressure": 1.0}
RATE_HZ, IRON_UT = 50.0, np.array((30.0, -20.0, 60.0))
LOGS = Path(__file__).resolve().parents[3] / "shared" / "data" / "indoor-location" / "site1"


@dataclass(frozen=True)
class Sensors:
    """What one device measured, to be written in other units and axes."""

    acc: Stream
    gyro: Stream
    mag: Stream

    def judged(self, named: dict[str, float] | None = None, **orders: FloatArray) -> Judged:
        """Judged after its axes were put into another order, and its values scaled."""
        streams = {name: getattr(self, name) for name in ("acc", "gyro", "mag")}
        turned = {
            name: Stream(s.t_s, s.values @ np.atleast_2d(orders[name]).T if name in orders else s.values)
            for name, s in streams.items()
        }
        return judge_sensors(**turned, named_scales=named)


def walk(duration_s: float = 25.0, tilting_rad: float = 0.25, seed: int = 3) -> Sensors:
    """Somebody who turns and tilts a device at the frequencies of walking, and bounces at 2 Hz."""
    rng = np.random.default_rng(seed)
    t_s = np.arange(0.0, duration_s, 1.0 / RATE_HZ)
    slow = [np.sin(2 * np.pi * f * t_s + p) for f, p in zip((0.11, 0.17, 0.23), rng.uniform(0, 6, 3), strict=True)]
    yaw, pitch, roll = 2.0 * slow[0], 0.6 + tilting_rad * slow[1], tilting_rad * slow[2]
    turn = Rotation.from_euler("ZYX", np.stack((yaw, pitch, roll), axis=1))
    rate = (turn[:-1].inv() * turn[1:]).as_rotvec() * RATE_HZ
    rate = np.vstack((rate, rate[-1:]))
    bounce = np.stack((0.5 * np.cos(4 * np.pi * t_s), 0.2 * np.sin(2 * np.pi * t_s), 2.0 * np.sin(4 * np.pi * t_s)))
    acc = turn.inv().apply(bounce.T + np.array((0.0, 0.0, G))) + rng.normal(0.0, 0.05, (len(t_s), 3))
    mag = turn.inv().apply((5.0, 20.0, -43.0)) + IRON_UT + rng.normal(0.0, 0.3, (len(t_s), 3))
    mid = t_s + 0.5 / RATE_HZ
    return Sensors(Stream(t_s, acc), Stream(mid, rate + np.array((0.02, -0.03, 0.01))), Stream(t_s, mag))


WALK = walk()


def test_rotations_of_a_steady_turn_in_closed_form() -> None:
    """Ṙ = R [ω×] with constant ω is the exponential of ω t; from the window's middle."""
    rate = np.tile((0.3, -0.8, 1.1), (2, 20, 1))
    turned = integrate(rate)
    after = Rotation.from_matrix(turned[13, 1]).as_rotvec()
    assert after == pytest.approx(np.array((0.3, -0.8, 1.1)) * 0.04 * 3, abs=1e-12)


def test_windows_leave_out_holes() -> None:
    """No window spans a hole; the mean over a cell is the polyline's."""
    keep = (WALK.gyro.t_s < 10.0) | (WALK.gyro.t_s > 11.0)
    holed = Stream(WALK.gyro.t_s[keep], WALK.gyro.values[keep])
    whole, left = cut(WALK.gyro, WALK.acc, 3.0), cut(holed, WALK.acc, 3.0)
    assert 3 <= len(whole) - len(left) <= 5
    ramp = Stream(WALK.acc.t_s, np.outer(WALK.acc.t_s, (1.0, 2.0, -3.0)))
    middle = cut(WALK.gyro, ramp, 3.0).vector[0]
    assert np.diff(middle, axis=0) == pytest.approx(np.tile(0.04 * np.array((1.0, 2.0, -3.0)), (74, 1)), abs=1e-9)


@pytest.mark.parametrize("silence_s", [30.0, 90.0, 600.0, 5e7])
def test_a_silence_of_years_costs_nothing_and_changes_nothing(silence_s: float) -> None:
    """A clock that is set in the middle of a log; the windows on both sides are those that a silence of 30 s leaves."""

    def silent(stream: Stream, after_s: float) -> Stream:
        t_s = stream.t_s - 0.004  # off the edges of cells, so that rounding moves no sample to another
        return Stream(np.where(t_s > 20.0, t_s + after_s, t_s), stream.values)

    usual, after = (cut(silent(WALK.gyro, s), silent(WALK.acc, s), 3.0) for s in (30.0, silence_s))
    assert len(after) == len(usual) > 10
    assert after.vector == pytest.approx(usual.vector, abs=1e-5)
    assert after.rate == pytest.approx(usual.rate, abs=1e-5)


def test_as_named_nothing_is_changed() -> None:
    """Right names are kept, surely and in silence."""
    judged = WALK.judged(NAMED)
    assert judged.texts == ()
    assert [j.straight and j.sure for j in (judged.acc, judged.gyro, judged.mag) if j] == [True] * 3


@pytest.mark.parametrize("order", [*range(1, 48, 6), 24])
def test_any_order_of_the_magnetometer(order: int) -> None:
    """Some of 48; only all signs negated cannot be told from south of the equator, which is said."""
    judged = WALK.judged(NAMED, mag=SIGNED_ORDERS[order])
    assert judged.acc.straight
    assert judged.gyro.straight
    assert judged.mag is not None
    if (SIGNED_ORDERS[order] == -np.eye(3)).all():
        assert judged.mag.straight
        assert not judged.mag.sure
        assert "south" in judged.mag.text
    else:
        assert judged.mag.axes.tolist() == SIGNED_ORDERS[order].T.tolist()
        assert told_axes(judged.mag.axes) in judged.mag.text


@pytest.mark.parametrize("order", [*range(3, 48, 7), 24])
def test_any_order_of_the_gyroscope(order: int) -> None:
    """Two against one: the gyroscope is turned, mirrored or not."""
    judged = WALK.judged(NAMED, gyro=SIGNED_ORDERS[order])
    assert judged.gyro.axes.tolist() == SIGNED_ORDERS[order].T.tolist()
    assert judged.acc.straight
    assert judged.mag is not None
    assert judged.mag.straight


@pytest.mark.parametrize("axes", [np.diag((1.0, 1.0, -1.0)), np.eye(3)[[0, 2, 1]], np.eye(3)[[1, 2, 0]]])
def test_a_mirrored_accelerometer(axes: FloatArray) -> None:
    """With a magnetometer it is told from a turned gyroscope; without one the likelier is taken, and that is said."""
    judged = WALK.judged(NAMED, acc=axes)
    assert judged.acc.axes.tolist() == axes.T.tolist()
    assert judged.gyro.straight
    assert judged.acc.sure
    alone = judge_sensors(Stream(WALK.acc.t_s, WALK.acc.values @ axes.T), WALK.gyro, named_scales=NAMED)
    turned = alone.gyro if alone.acc.straight else alone.acc
    assert not turned.sure
    assert "without a magnetometer" in turned.text


def test_gravity_with_the_sign_of_ios() -> None:
    """Face down under a field into the sky: turned; without a magnetometer only said."""
    judged = WALK.judged(NAMED, acc=-np.eye(3))
    assert judged.acc.axes.tolist() == (-np.eye(3)).tolist()
    assert "iOS" in judged.acc.text
    alone = judge_sensors(Stream(WALK.acc.t_s, -WALK.acc.values), WALK.gyro, named_scales=NAMED)
    assert alone.acc.straight
    assert not alone.acc.sure
    assert "iOS" in alone.acc.text


@pytest.mark.parametrize(
    ("sensor", "factor", "whole"),
    [
        ("gyro", 180 / np.pi, False),
        ("gyro", 180e3 / np.pi, False),
        ("gyro", 16.4 * 180 / np.pi, True),
        ("gyro", 131 * 180 / np.pi, True),
        ("acc", 1 / G, False),
        ("acc", 1000 / G, False),
        ("acc", 4096 / G, True),
        ("acc", 16384 / G, True),
        ("mag", 10.0, False),
        ("mag", 0.01, False),
    ],
)
def test_units_without_and_against_names(sensor: str, factor: float, whole: bool) -> None:
    """Unnamed, each unit is found; named SI, it is found and said."""
    stream: Stream = getattr(WALK, sensor)
    values = stream.values * factor
    streams = {name: getattr(WALK, name) for name in ("acc", "gyro", "mag")}
    streams[sensor] = Stream(stream.t_s, np.rint(values) if whole else values)
    unnamed = getattr(judge_sensors(**streams), sensor)
    assert unnamed.scale * factor == pytest.approx(1.0, rel=1e-3)
    assert unnamed.sure
    named = getattr(judge_sensors(**streams, named_scales=NAMED), sensor)
    assert named.scale * factor == pytest.approx(1.0, rel=1e-3)
    assert "named" in named.text
    assert named.by == "physics"


def test_raw_counts_of_a_magnetometer_are_scaled_to_a_field() -> None:
    """Of counts that no unit fits only the direction is known: 50 µT without the hard iron."""
    judged = WALK.judged({"acc": 1.0, "gyro": 1.0}, mag=0.05 * np.eye(3)).mag
    assert judged is not None
    assert not judged.sure
    assert judged.scale == pytest.approx(50.0 / (47.7 * 0.05), rel=0.05)


def test_acceleration_without_gravity_is_seen() -> None:
    """In any unit, named or not; and nothing is said against a walk with gravity."""
    linear = WALK.acc.values - np.array((0.0, 0.0, G))
    t_s = WALK.acc.t_s
    pushes = np.random.default_rng(0).normal(0.0, 1.5, linear.shape)
    for values, scale in ((pushes, 1.0), (pushes, None), (pushes / G, G), (pushes / G, None), (0.01 + 0 * pushes, 1.0)):
        assert judge_accelerometer(Stream(t_s, values), scale).gravity_removed
    assert not judge_accelerometer(WALK.acc).gravity_removed
    assert judge_sensors(Stream(t_s, pushes), WALK.gyro, WALK.mag, None, NAMED).acc.gravity_removed


def test_still_nothing_is_sure() -> None:
    """Of a device on a table only gravity tells; the gyroscope's unit is assumed, and that is said."""
    t_s, rng = WALK.acc.t_s, np.random.default_rng(1)
    acc = Stream(t_s, rng.normal(0.0, 0.02, (len(t_s), 3)) + np.array((0.0, 0.0, G)))
    gyro = Stream(t_s, rng.normal(0.0, 0.1, (len(t_s), 3)))
    judged = judge_sensors(acc, gyro)
    assert judged.acc.sure
    assert judged.acc.unit == "m/s²"
    assert not judged.gyro.sure
    assert judged.gyro.unit == "°/s"
    assert judged.gyro.straight
    assert not judged.axes_told


@pytest.mark.parametrize(
    ("values", "named", "scale"),
    [
        (101325.0, None, 0.01),
        (101.3, None, 10.0),
        (1013.0, None, 1.0),
        (101325.0, 1.0, 0.01),
        (20.2, None, np.nan),
        (0.0, None, np.nan),
    ],
)
def test_pressure_is_near_an_atmosphere(values: float, named: float | None, scale: float) -> None:
    """Pa, hPa and kPa; an angle is none."""
    noise = 1e-5 * values * np.random.default_rng(2).normal(size=100)
    assert judge_pressure(values + noise, named).scale == pytest.approx(scale, nan_ok=True)
    assert np.isnan(judge_pressure(np.linspace(0.0, 360.0, 100) + 300.0).scale)


def test_chips_are_signed_orders() -> None:
    """Each of the table's is one of 48, and no two are the same."""
    assert set(map(", ".join, CHIPS.values())) <= {told_axes(order) for order in SIGNED_ORDERS}


@pytest.mark.skipif(not LOGS.is_dir(), reason="the real logs of ../shared/data are not there")
def test_real_walks_keep_their_axes_and_show_planted_errors() -> None:
    """Phones are right as they are, whole and cut to 20 s; planted errors are found or said, never mistaken."""
    found = 0
    for path in sorted(LOGS.glob("F*/*.gz"))[::24]:
        log = read_log(path).log
        sensors = Sensors(log.acc, log.gyro, log.mag)
        short = log.between(3.0, 23.0)
        for some in (sensors, Sensors(short.acc, short.gyro, short.mag)):
            for named in (NAMED, None):
                judged = some.judged(named)
                assert judged.mag is not None
                for one in (judged.acc, judged.gyro, judged.mag):
                    assert one.straight
                    assert one.scale == 1.0
        for name, axes in (
            ("gyro", -np.eye(3)),
            ("gyro", np.diag((1.0, 1.0, -1.0))),
            ("mag", np.diag((1.0, -1.0, -1.0))),
        ):
            judged = sensors.judged(NAMED, **{name: axes})
            one = getattr(judged, name)
            found += not one.straight
            assert one.axes.tolist() == axes.tolist() or (one.straight and judged.texts)
    assert found >= 6
