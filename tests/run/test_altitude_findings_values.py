"""What is told of air pressure: rides, leaps, gusts, noise, silence, each limit on both of its sides."""

from typing import Any

import numpy as np
import pytest
from support.by_hand import way_along
from support.results_by_hand import changed, hand_result

from fbgraph.run.altitude_findings import altitude_findings
from fbgraph.run.finding import Finding

WAY = way_along((0.0, 0.0), (25.0, 0.0), t0_s=1.0)  # 50 steps of 0.5 m and 0.5 s, from 1 s to 26 s


def told(**columns: Any) -> list[Finding]:
    usual = {"altitude_m": np.full(51, 300.0), "altitude_sigma_m": np.full(51, 0.1)}
    return altitude_findings(hand_result(WAY, steps=usual | columns))


def test_of_still_air_nothing_is_told() -> None:
    assert told() == []
    assert told(altitude_m=np.full(51, np.nan)) == []  # a log without a barometer


@pytest.mark.parametrize(("rise_m", "said"), [(12.04, "+12.0 m"), (-3.0, "-3.0 m")])
def test_a_ride_is_told_with_its_height_and_its_place(rise_m: float, said: str) -> None:
    (found,) = told(carried_m=changed(51, [20], rise_m, 0.0))
    assert (found.kind, found.start_s, found.end_s) == ("lift", 10.5, 10.5)
    text = f"the altitude changed by {said} without a step (between steps 19 and 20): a lift or an escalator"
    assert found.text == text
    parts = told(carried_m=changed(51, range(20, 24), 0.25 * rise_m, 0.0))
    assert [f.text for f in parts] == [text.replace("and 20", "and 23")]
    assert len(told(carried_m=changed(51, [10, 40], rise_m, 0.0))) == 2


def test_leaps_close_together_are_told_as_one() -> None:
    (found,) = told(blown_m=changed(51, [10], 8.4, 0.0) - changed(51, [13], 6.0, 0.0))
    assert (found.kind, found.start_s, found.end_s) == ("pressure", 5.5, 7.5)
    assert found.text == (
        "air pressure leapt by up to 8.4 m of altitude at 2 steps: a door, a gust or a finger on the sensor, "
        "not followed"
    )
    (alone,) = told(blown_m=changed(51, [10], -1.0, 0.0))
    assert "by up to 1.0 m of altitude at 1 step:" in alone.text
    assert len(told(blown_m=changed(51, [5, 40], 8.4, 0.0))) == 2
    assert told(blown_m=changed(51, range(5, 9), 0.8, 0.0)) == []


def test_a_climb_that_legs_cannot_is_told_with_its_sum() -> None:
    (found,) = told(blown_m=changed(51, range(10, 40), -0.6, 0.0))
    assert found.text == (
        "air pressure changed for 15 s as on a climb of -18 m, faster than legs climb: not followed, and altitude is "
        "uncertain by as much"
    )
    (short,) = told(blown_m=changed(51, range(10, 29), 0.9, 0.0))
    assert "leapt" in short.text


def test_the_weather_during_a_rest_is_no_news_up_to_three_hectopascals_an_hour() -> None:
    rested = WAY.t_s + 300.0 * (np.arange(51) >= 20)
    for blown_m, count in ((2.9, 0), (3.1, 1), (-3.1, 1)):
        found = told(t_s=rested, start_s=rested - 0.5, blown_m=changed(51, [20], blown_m, 0.0))
        assert len(found) == count
        if found:
            assert found[0].text.startswith(
                f"air pressure changed by {blown_m:+.1f} m of altitude while nobody stepped"
            )
            assert (found[0].start_s, found[0].end_s) == (10.5, 311.0)


def test_gusts_are_told_instead_of_their_leaps() -> None:
    (found,) = told(
        gusty=np.arange(51) >= 20,
        altitude_sigma_m=changed(51, range(20, 51), 0.9, 0.1),
        blown_m=changed(51, range(30, 40), 1.0, 0.0),
    )
    assert found.text == (
        "air pressure goes to and fro by ±0.9 m of altitude (1σ) over 31 steps: wind or a draught on the sensor; "
        "no slope is read from it, and altitude is uncertain"
    )
    assert told(gusty=np.arange(51) >= 32) == []  # 19 steps are no wind yet


def test_noise_is_told_if_it_lasts() -> None:
    for count, sigma_m, times in ((40, 0.51, 1), (40, 0.49, 0), (39, 5.0, 0)):
        found = told(altitude_sigma_m=changed(51, range(5, 5 + count), sigma_m, 0.1))
        assert len(found) == times
        assert all("is noisy by ±0.5 m" in one.text for one in found)


def test_a_barometer_that_falls_silent_is_told() -> None:
    (found,) = told(altitude_m=changed(51, range(25, 45), np.nan, 300.0))
    assert found.text.startswith("the barometer said nothing new for 20 steps")
    assert (found.start_s, found.end_s) == (13.0, 23.0)
    assert told(altitude_m=changed(51, range(25, 44), np.nan, 300.0)) == []
