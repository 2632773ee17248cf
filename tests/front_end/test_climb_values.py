"""What of a change of pressure a walker made, on altitudes made of formulae: slope, rides, gusts, leaps."""

import math
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from support.made_signals import levelled

from fbgraph.core.config import StepLengthConfig
from fbgraph.core.geometry import FloatArray
from fbgraph.front_end.climb import Air, ClimbGauge, off_lines
from fbgraph.front_end.step_track import Peak

CONFIG = StepLengthConfig(alpha_m=0.4, beta_m_s=0.2, gamma_m=-1.5, beta2_m_s2=0.0, kappa_surge=0.0, min_climb_m_s=0.2)
"""At 2 Hz 0.8 m, 1.6 m/s."""
Height = Callable[[FloatArray], FloatArray]


def walked(
    height_m: Height, duration_s: float = 60.0, rests: tuple[tuple[float, float], ...] = (), **given: Any
) -> dict[float, Air]:
    """What pressure says at each step of a walk at 2 Hz, by the time at which it ends."""
    index = np.arange(round(duration_s * 100.0), dtype=np.int64)
    altitude_m = 300.0 + height_m(index / 100.0)
    gauge, chunk, done = ClimbGauge(CONFIG, 100.0), given.get("chunk", 10**9), 0
    air: dict[float, Air] = {}
    ends = np.arange(500, len(index) - 100, 50)
    resting = np.zeros(len(ends), dtype=bool)
    for begin_s, end_s in rests:
        resting |= (ends - 50 < 100.0 * end_s) & (ends > 100.0 * begin_s)
    for end in ends[~resting].tolist():
        while done <= end:
            part = slice(done, done + chunk)
            gauge.push(levelled(len(index[part]), index=index[part], altitude_m=altitude_m[part]))
            done += chunk
        altitude = float(altitude_m[end - 49 : end + 1].mean())
        air[end / 100.0] = gauge.judge(Peak(end, end - 50, first=False), altitude, 2.0, 5.0, chained=True)
    return air


def slopes(air: dict[float, Air], since_s: float = 0.0, until_s: float = 1e9) -> list[float]:
    return [one.slope for t_s, one in air.items() if since_s <= t_s <= until_s]


def stairs(t_s: FloatArray) -> FloatArray:
    """Three metres up from 20 s on, at 0.4 m/s."""
    return np.asarray(np.interp(t_s, (20.0, 27.5), (0.0, 3.0)))


def test_a_flight_of_stairs_is_a_slope_and_level_ground_is_none() -> None:
    air = walked(stairs)
    assert slopes(air, 25.0, 27.5) == pytest.approx([0.25] * 6)
    assert set(slopes(air, 0.0, 20.0)) == set(slopes(air, 32.5)) == {0.0}
    assert all((one.carried_m, one.blown_m) == (0.0, 0.0) for one in air.values())
    down = walked(lambda t: -stairs(t))
    assert slopes(down) == pytest.approx(slopes(air))


def test_flights_with_landings_and_a_turn_at_the_top_keep_their_slope() -> None:
    flights = walked(lambda t: np.asarray(np.interp(t, (10, 17, 20, 27, 30, 37), (0, 2.8, 2.8, 5.6, 5.6, 8.4))))
    for top_s in (17.0, 27.0, 37.0):
        assert min(slopes(flights, top_s - 2.0, top_s)) > 0.2
    there_and_back = walked(lambda t: np.asarray(np.interp(t, (20, 28, 30, 38), (0.0, 3.2, 3.2, 0.0))))
    assert min(slopes(there_and_back, 35.0, 38.0)) > 0.2


@pytest.mark.parametrize("height_m", [0.9, 3.0, 8.4, -8.4, 80.0])
@pytest.mark.parametrize("lasts_s", [0.5, 1.5, 5.0, 1000.0])
def test_a_leap_of_pressure_is_no_slope(height_m: float, lasts_s: float) -> None:
    air = walked(lambda t: np.asarray(height_m * ((t > 20.0) & (t < 20.0 + lasts_s)), dtype=np.float64))
    assert sum(slope > 0.0 for slope in slopes(air)) <= (2 if abs(height_m) < 1.35 else 0)
    blown = [one.blown_m for one in air.values() if one.blown_m]
    expected = height_m if lasts_s > 900.0 else 0.0
    assert sum(blown) == pytest.approx(expected, abs=0.9)
    assert all(one.carried_m == 0.0 for one in air.values())


@pytest.mark.parametrize(("count", "slope"), [(2.0, 0.25), (10.0, 0.0)])
def test_where_no_step_was_seen_there_is_no_slope(count: float, slope: float) -> None:
    gauge = ClimbGauge(CONFIG, 100.0)
    gauge.push(levelled(3000, altitude_m=300.0 + stairs(np.arange(3000) / 100.0)))
    assert gauge.judge(Peak(2650, 2550, True, count=count), 302.0, 2.0, 5.0, True).slope == pytest.approx(slope)


def test_doors_on_the_way_do_not_hide_the_stairs() -> None:
    doors = walked(lambda t: stairs(t) + 4.0 * ((t > 5.0) & (t < 6.5)) + 4.0 * ((t > 9.0) & (t < 10.5)))
    assert not any(one.gusty for one in doors.values())
    assert slopes(doors, 25.0, 27.5) == pytest.approx([0.25] * 6)


@pytest.mark.parametrize("period_s", [3.0, 6.0, 10.0, 20.0])
def test_gusts_are_known_after_their_second_turn(period_s: float) -> None:
    """A wind of 7 m/s: 1.25 m of altitude either way."""
    air = walked(lambda t: 1.25 * np.sin(2.0 * math.pi * t / period_s), 120.0)
    assert set(slopes(air, 5.0 + 2.0 * period_s)) == {0.0}
    assert sum(slope > 0.0 for slope in slopes(air)) <= 16
    late = [one for t_s, one in air.items() if t_s > 60.0]
    assert all(one.gusty for one in late) == (period_s > 3.0)
    assert np.mean([one.sigma_m for one in late]) == pytest.approx(1.25 / math.sqrt(2.0), rel=0.1)


def test_still_air_is_not_gusty_and_its_sigma_is_its_noise() -> None:
    noise = np.random.default_rng(3).normal(0.0, 0.2, 10_000)
    air = walked(lambda t: np.asarray(noise[: len(t)], dtype=np.float64))
    assert not any(one.gusty for one in air.values())
    assert np.mean([one.sigma_m for one in air.values()]) == pytest.approx(0.2, rel=0.1)
    assert set(slopes(air)) == {0.0}
    silent = walked(lambda t: np.full(len(t), np.nan))
    assert all(math.isnan(one.sigma_m) and one.blown_m == one.carried_m == one.slope == 0.0 for one in silent.values())


def test_pressure_that_climbs_faster_than_legs_is_the_airs() -> None:
    """20 hPa in 300 s: 0.31 m a step, for ever."""
    air = walked(lambda t: 0.62 * np.maximum(t - 10.0, 0.0))
    assert set(slopes(air, 15.0)) == {0.0}
    blown = np.array([one.blown_m for t_s, one in air.items() if t_s > 15.0])
    assert blown == pytest.approx(0.31)


def lift(rise_m: float, begin_s: float, speed_m_s: float) -> Height:
    """Smoothly, from one floor to another."""

    def height_m(t_s: FloatArray) -> FloatArray:
        x = np.clip((t_s - begin_s) * speed_m_s / abs(rise_m), 0.0, 1.0)
        return np.asarray(rise_m * (3.0 * x**2 - 2.0 * x**3))

    return height_m


@pytest.mark.parametrize(
    ("rise_m", "speed_m_s"), [(3.0, 1.0), (-3.0, 1.5), (12.0, 1.2), (40.0, 2.5), (-40.0, 2.5), (5.0, 0.3), (-4.0, 0.25)]
)
@pytest.mark.parametrize("chunk", [10**9, 130])
def test_who_rises_without_steps_is_carried(rise_m: float, speed_m_s: float, chunk: int) -> None:
    air = walked(lift(rise_m, 25.0, speed_m_s), 80.0, rests=((20.0, 50.0),), chunk=chunk)
    carried = {t_s: one.carried_m for t_s, one in air.items() if one.carried_m}
    assert carried == {50.5: pytest.approx(rise_m, abs=0.15)}
    assert set(slopes(air)) == {0.0}
    assert all(one.blown_m == 0.0 for one in air.values())


@pytest.mark.parametrize(
    ("height_m", "blown_m"),
    [
        (lambda t: 0.005 * np.clip(t - 25.0, 0.0, 600.0), 3.0),  # the weather
        (lambda t: 3.0 * (t > 40.0), 3.0),  # a door opened, and left open
        (lambda t: 8.4 * ((t > 40.0) & (t < 44.0)), 0.0),  # and one closed again
        (lambda t: 4.0 * -np.expm1(-np.maximum(t - 40.0, 0.0) / 0.5), 4.0),  # one that opened with a rush
        (lambda t: 3.0 * np.sin(t / 3.0) * ((t > 60.0) & (t < 60.0 + 30.0 * math.pi)), 0.0),  # gusts
        (lambda t: 3.0 * np.sin(np.clip(t / 3.0, 20.0 * math.pi, 30.5 * math.pi)), 3.0),  # that end at their height
        (lambda t: lift(6.0, 40.0, 1.0)(t) - lift(6.0, 300.0, 1.0)(t), 0.0),  # up and down again
    ],
)
def test_what_else_pressure_does_during_a_rest_carries_nobody(height_m: Height, blown_m: float) -> None:
    air = walked(height_m, 680.0, rests=((20.0, 640.0),))
    after = air[640.5]
    assert after.carried_m == 0.0
    assert after.blown_m == pytest.approx(blown_m, abs=0.1)
    assert set(slopes(air)) == {0.0}


def test_steps_seen_in_a_lift_do_not_stop_it() -> None:
    """Somebody shuffles on the way up: most of the ride is one."""
    air = walked(lift(20.0, 25.0, 1.6))
    assert sum(one.carried_m for one in air.values()) > 12.0
    assert sum(one.carried_m + one.blown_m for one in air.values()) == pytest.approx(20.0, abs=3.0)


def test_any_pieces_give_the_same() -> None:
    noise = np.random.default_rng(8).normal(0.0, 0.3, 20_000)

    def height_m(t_s: FloatArray) -> FloatArray:
        return np.asarray(stairs(t_s) + lift(9.0, 45.0, 1.5)(t_s) + noise[: len(t_s)])

    whole = walked(height_m, 100.0, rests=((40.0, 70.0),))
    for chunk in (51, 333, 1000):
        assert walked(height_m, 100.0, rests=((40.0, 70.0),), chunk=chunk) == whole


def test_every_window_is_compared_with_its_own_line() -> None:
    rng = np.random.default_rng(0)
    altitude_m = 4000.0 + np.cumsum(rng.normal(0.0, 0.1, 81))
    told = off_lines(altitude_m, 20)
    assert len(told) == 62
    for i, off_m in enumerate(told.tolist()):
        t, window = np.arange(20.0), altitude_m[i : i + 20]
        assert off_m == pytest.approx(np.std(window - np.polyval(np.polyfit(t, window, 1), t)), abs=1e-9)
    assert off_lines(np.full(30, 250.0), 20).tolist() == [0.0] * 11
