"""The wearer's rhythm on cosines: period, strength, stride, breadth, and the same frames however the samples come."""

from typing import Any

import numpy as np
import pytest
from support.made_signals import G, levelled

from fbgraph.core.config import StepsConfig
from fbgraph.core.geometry import FloatArray
from fbgraph.front_end.levelled_signals import LevelledSignals
from fbgraph.front_end.rhythm import FRAME_S, Frames, Rhythm
from fbgraph.front_end.step_detector import StepDetector

NAMES = ("index", "period_s", "strength", "stride", "single", "breadth", "moved_m_s2", "swing_rad_s")


def moving(up: FloatArray, ahead: FloatArray | float = 0.0, left: FloatArray | float = 0.0, **given: Any) -> Any:
    """Signals of a device accelerated like this above gravity."""
    columns = np.column_stack([np.broadcast_to(axis, len(up)) for axis in (ahead, left, G + up)])
    made = levelled(len(up), acc_norm_m_s2=np.sqrt((columns**2).sum(axis=1)), up_m_s2=G + up, **given)
    return LevelledSignals(**{**vars(made), "acc_n_m_s2": columns})


def gait(cadence_hz: float, seconds: float = 12.0, bounce: float = 1.5, **given: Any) -> Any:
    """Bounce and push with every step, sway with every other."""
    phase = 2 * np.pi * cadence_hz * np.arange(round(seconds * 100)) / 100.0
    push, sway = 0.5 * bounce * np.cos(phase + 1.5), 0.4 * bounce * np.cos(phase / 2)
    return moving(bounce * np.cos(phase), push, sway, **given)


def last(signals: LevelledSignals) -> dict[str, float]:
    frames = Rhythm(100.0).push(signals)
    return {name: float(getattr(frames, name)[-1]) for name in NAMES}


@pytest.mark.parametrize("cadence_hz", [0.7, 0.75, 1.0, 1.37, 1.8, 2.2, 2.6, 3.05, 3.2])
def test_the_period_is_that_of_the_steps(cadence_hz: float) -> None:
    frame = last(gait(cadence_hz))
    assert frame["period_s"] == pytest.approx(1.0 / cadence_hz, rel=0.02)
    assert frame["strength"] > 0.9
    assert frame["single"]
    if cadence_hz > 1.0:
        assert frame["stride"] > 0.9


def test_noise_has_no_rhythm() -> None:
    rng = np.random.default_rng(3)
    frames = Rhythm(100.0).push(moving(*rng.normal(0.0, 2.0, (3, 3000))))
    assert np.median(frames.strength[20:]) < 0.45
    assert np.median(frames.stride[20:]) < 0.3


def test_a_limbs_one_top_a_stride_is_two_steps() -> None:
    """The same curve held still is somebody who walks slowly; a device that tilts at 1 rad/s hangs on a limb."""
    assert last(gait(0.95))["period_s"] == pytest.approx(1.05, abs=0.02)
    assert last(gait(0.95, tilt_rate_rad_s=1.0))["period_s"] == pytest.approx(0.526, abs=0.01)
    assert last(gait(0.95, tilt_rate_rad_s=1.0))["swing_rad_s"] == pytest.approx(1.0)
    assert last(gait(1.8, tilt_rate_rad_s=1.0))["period_s"] == pytest.approx(1 / 1.8, abs=0.01)


def test_two_uneven_tops_a_stride_are_two_steps() -> None:
    phase = 2 * np.pi * 0.95 * np.arange(1200) / 100.0
    uneven = moving(1.0 * np.cos(phase) + 1.5 * np.cos(2 * phase), np.cos(phase), np.sin(phase), tilt_rate_rad_s=0.6)
    frame = last(uneven)
    assert frame["period_s"] == pytest.approx(0.526, abs=0.015)
    assert not frame["single"]


def test_breadth_is_none_on_one_line_and_two_thirds_where_all_directions_are_alike() -> None:
    wave = 2.0 * np.cos(2 * np.pi * 2.0 * np.arange(1000) / 100.0)
    assert last(moving(wave))["breadth"] == pytest.approx(0.0, abs=1e-9)
    assert last(moving(0.8 * wave, 0.6 * wave))["breadth"] == pytest.approx(0.0, abs=1e-9)
    circle = last(moving(wave, 2.0 * np.sin(2 * np.pi * 2.0 * np.arange(1000) / 100.0)))
    assert circle["breadth"] == pytest.approx(0.5, abs=0.01)  # 1 - (1 + 1) / 2²
    assert circle["moved_m_s2"] == pytest.approx(2.0, abs=0.05)
    rng = np.random.default_rng(0)
    smooth = [np.convolve(rng.normal(0.0, 5.0, 4000), np.ones(8) / 8.0, "same") for _ in range(3)]
    frames = Rhythm(100.0).push(moving(*smooth))
    assert np.median(frames.breadth[50:]) == pytest.approx(2.0 / 3.0, abs=0.05)


def test_who_moves_on_one_line_does_not_walk() -> None:
    """However the device turns meanwhile; with a push across it is somebody's gait."""
    wave = 2.0 * np.cos(2 * np.pi * 2.0 * np.arange(1500) / 100.0)
    across = np.roll(0.3 * wave, 12)

    def tops(signals: LevelledSignals) -> int:
        return sum(len(run) for run in StepDetector(StepsConfig(), 100.0).push(signals))

    assert tops(moving(wave, 0.5 * wave, tilt_rate_rad_s=0.3)) == 0
    assert tops(moving(wave, across, tilt_rate_rad_s=0.3)) > 25
    assert tops(moving(wave, across, tilt_rate_rad_s=0.02)) == 0  # no hand is so still that moves so much
    assert tops(moving(wave, across, tilt_rate_rad_s=0.0)) > 25  # but a dead gyroscope is


def test_a_frame_is_told_every_sixteenth_sample_by_the_samples_up_to_it() -> None:
    signals = gait(1.8)
    frames = Rhythm(100.0).push(signals)
    assert frames.index.tolist() == list(range(15, 1200, 16))
    assert FRAME_S == 0.16
    assert set(Rhythm(100.0).push(gait(1.8, first=13)).index % 16) == {15}  # wherever a log begins
    part = Rhythm(100.0).push(signals.head(800))
    assert all(np.array_equal(getattr(part, name), getattr(frames, name)[: len(part)]) for name in NAMES)


@pytest.mark.parametrize("chunk", [1, 7, 100, 1111])
def test_any_chunks_give_the_same_bits(chunk: int) -> None:
    rng = np.random.default_rng(2)
    signals = moving(*rng.normal(0.0, 1.0, (3, 3000)), first=13)
    rhythm = Rhythm(100.0)
    pieces = [rhythm.push(signals.tail(len(signals) - at).head(chunk)) for at in range(0, len(signals), chunk)]
    whole, cut = Rhythm(100.0).push(signals), Frames.concatenate(pieces)
    assert all(np.array_equal(getattr(whole, name), getattr(cut, name)) for name in NAMES)
    assert len(whole) == 187


@pytest.mark.parametrize("gap", [False, True])
def test_frames_that_may_come_later_are_the_same(gap: bool) -> None:
    rng = np.random.default_rng(3)
    signals = moving(*rng.normal(0.0, 1.0, (3, 3000)), first=13)
    if gap:
        keep = (np.arange(3000) < 1003) | (np.arange(3000) >= 1101)
        signals = LevelledSignals(**{name: column[keep] for name, column in vars(signals).items()})
    rhythm, pieces = Rhythm(100.0), []
    for at in range(0, len(signals), 50):
        piece = signals.tail(len(signals) - at).head(50)
        until = int(piece.index[int(rng.integers(len(piece)))]) if at % 150 else None
        pieces.append(rhythm.push(piece, until))
        assert gap or until is None or not len(pieces[-1]) or pieces[-1].index[-1] <= until < pieces[-1].index[-1] + 16
    pieces.append(rhythm.push(moving(*rng.normal(0.0, 1.0, (3, 10)), first=3013)))
    whole, cut = Rhythm(100.0).push(signals), Frames.concatenate(pieces)
    assert all(np.array_equal(getattr(whole, name), getattr(cut, name)[: len(whole)]) for name in NAMES)


def test_after_a_gap_between_two_pieces_too() -> None:
    signals = gait(1.8, 24.0)
    before, after = signals.head(16 * 60), signals.tail(2400 - 16 * 70)
    rhythm = Rhythm(100.0)
    rhythm.push(before)  # up to the very end of a frame
    assert np.array_equal(rhythm.push(after).strength, Rhythm(100.0).push(after).strength)


def test_after_a_gap_the_rhythm_begins_anew() -> None:
    signals, index = gait(1.8, 24.0), np.arange(2400)
    keep = (index < 1000) | (index >= 1100)
    cut = LevelledSignals(**{name: column[keep] for name, column in vars(signals).items()})
    frames, fresh = (
        Rhythm(100.0).push(cut),
        Rhythm(100.0).push(LevelledSignals(**{name: column[1100:] for name, column in vars(signals).items()})),
    )
    after = frames.index >= 1100
    assert frames.index[after].tolist() == fresh.index.tolist()
    assert np.array_equal(frames.strength[after], fresh.strength)
    assert frames.strength[~after][-1] > 0.9
    assert frames.strength[after][1] < 0.5
