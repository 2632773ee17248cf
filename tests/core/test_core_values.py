"""The standard atmosphere, angles, rotations, units and logs at values known from elsewhere."""

import math

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from fbgraph.core import errors
from fbgraph.core.atmosphere import altitude_pressure_hpa, pressure_altitude_m
from fbgraph.core.geometry import heading_deg, rotate, wrap_angle, wrap_scalar
from fbgraph.core.sensor_log import Event, SensorLog, Stream, empty_stream
from fbgraph.core.units import DEGREE_RAD, STANDARD_GRAVITY_M_S2

ICAO = {
    -500.0: 1074.78,
    0.0: 1013.25,
    500.0: 954.61,
    1000.0: 898.75,
    2000.0: 794.95,
    3000.0: 701.09,
    5000.0: 540.20,
    8000.0: 356.00,
    11000.0: 226.32,
}
"""Geopotential altitude in metres and pressure in hPa, ICAO Doc 7488 (ISO 2533), table of the troposphere."""


def test_the_atmosphere_is_icaos_table_both_ways() -> None:
    altitude, pressure = np.array(list(ICAO)), np.array(list(ICAO.values()))
    assert np.allclose(altitude_pressure_hpa(altitude), pressure, atol=0.02)
    assert np.allclose(
        pressure_altitude_m(pressure), altitude, atol=0.7
    )  # the table's digits; 0.01 hPa are 0.3 m up there
    assert np.allclose(pressure_altitude_m(altitude_pressure_hpa(altitude)), altitude, atol=1e-6)
    assert pressure_altitude_m(1013.25).shape == ()


def test_angles_wrap_into_the_half_open_circle() -> None:
    angles = np.array([0.0, math.pi, -math.pi, 3.5, -3.5, 7.0, 100.0])
    wrapped = wrap_angle(angles)
    assert wrapped.tolist() == pytest.approx(
        [0.0, -math.pi, -math.pi, 3.5 - 2 * math.pi, 2 * math.pi - 3.5, 7.0 - 2 * math.pi, 100.0 - 32 * math.pi]
    )
    assert [wrap_scalar(a) for a in angles.tolist()] == pytest.approx(wrapped.tolist())
    assert wrap_angle(np.ones((2, 3))).shape == (2, 3)


def test_quaternions_rotate_as_scipys_do() -> None:
    rng = np.random.default_rng(0)
    rotation = Rotation.random(20, random_state=1)
    wxyz = np.roll(rotation.as_quat(), 1, axis=1)
    vectors = rng.normal(size=(20, 3))
    assert np.allclose(rotate(wxyz, vectors), rotation.apply(vectors))
    many = rng.normal(size=(20, 3, 4))
    for i in range(4):
        assert np.allclose(rotate(wxyz, many)[:, :, i], rotation.apply(many[:, :, i]))
    assert np.allclose(rotate(wxyz, vectors[0]), rotation.apply(vectors[0]))
    quarter = np.array([[math.sqrt(0.5), 0.0, 0.0, math.sqrt(0.5)]])  # a quarter turn to the left
    assert np.allclose(rotate(quarter, np.array([[1.0, 0.0, 0.0]])), [[0.0, 1.0, 0.0]])


@pytest.mark.parametrize(
    ("yaw", "heading"), [(0.0, 90.0), (math.pi / 2, 0.0), (math.pi, 270.0), (-math.pi / 2, 180.0), (7.0, 48.929)]
)
def test_a_heading_is_clockwise_from_north(yaw: float, heading: float) -> None:
    assert heading_deg(yaw) == pytest.approx(heading, abs=1e-3)


def test_units_are_those_of_the_si_brochure() -> None:
    assert STANDARD_GRAVITY_M_S2 == 9.80665
    assert pytest.approx(math.pi) == 180 * DEGREE_RAD


def test_each_error_ends_the_command_line_with_its_own_code() -> None:
    kinds = (errors.FbgraphError, errors.ConfigError, errors.DataError, errors.EstimationError)
    assert [kind.exit_code for kind in kinds] == [1, 2, 3, 4]
    assert all(issubclass(kind, errors.FbgraphError) for kind in kinds)


def stream(*times: float, width: int = 3) -> Stream:
    return Stream(np.array(times), np.arange(float(width * len(times))).reshape(-1, width))


NO_COMPASS, NO_BAROMETER = empty_stream(3), empty_stream(1)


def log(mag: Stream = NO_COMPASS, pressure: Stream = NO_BAROMETER, events: tuple[Event, ...] = ()) -> SensorLog:
    acc, gyro = stream(0.0, 0.1, 0.2, 0.5), stream(0.05, 0.15, 0.6)
    return SensorLog("walk", "made", 7.0, acc, gyro, mag, pressure, events)


def test_a_streams_rate_is_the_median() -> None:
    assert stream(0.0, 0.1, 0.2, 5.0).rate_hz == pytest.approx(10.0)
    assert math.isnan(stream(1.0).rate_hz)
    assert len(empty_stream(3)) == 0
    assert empty_stream(3).values.shape == (0, 3)


def test_a_log_lasts_from_its_first_to_its_last_inertial_sample() -> None:
    assert log().duration_s == pytest.approx(0.6)
    assert log(mag=stream(-5.0, 50.0)).duration_s == pytest.approx(0.6)


def test_pieces_hold_their_start_and_not_their_end() -> None:
    whole = log(mag=stream(0.0, 0.3), pressure=stream(0.1, 0.2, width=1), events=(Event(0.1, "a"), Event(0.2, "b")))
    piece = whole.between(0.1, 0.2)
    assert piece.acc.t_s.tolist() == [0.1]
    assert piece.acc.values.tolist() == [[3.0, 4.0, 5.0]]
    assert piece.gyro.t_s.tolist() == [0.15]
    assert len(piece.mag) == 0
    assert piece.pressure.t_s.tolist() == [0.1]
    assert piece.events == (Event(0.1, "a"),)
    assert piece.t0_s == 7.0


def test_pieces_in_order_are_the_log_again() -> None:
    whole = log(mag=stream(0.0, 0.3), pressure=stream(0.1, 0.2, width=1), events=(Event(0.1, "a"), Event(0.2, "b")))
    joined = SensorLog.concatenate([whole.between(lo, hi) for lo, hi in ((-9, 0.1), (0.1, 0.2), (0.2, 9))])
    for name in ("acc", "gyro", "mag", "pressure"):
        assert np.array_equal(getattr(joined, name).t_s, getattr(whole, name).t_s)
        assert np.array_equal(getattr(joined, name).values, getattr(whole, name).values)
    assert joined.events == whole.events
