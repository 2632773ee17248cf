"""Iron of the device, online: learned, said anew when the window moves or the magnetometer is calibrated anew."""

import numpy as np
import pytest
from support.factors import seed_of
from support.magnetised import LEVEL_UT, laps, magnetised
from support.windows import EXACT, walked

from fbgraph.core.config import GraphConfig, SolverConfig
from fbgraph.core.geometry import wrap_angle
from fbgraph.estimators.batch_smoother import smooth
from fbgraph.estimators.estimates import Smoothed
from fbgraph.estimators.isam_window import IsamWindow
from fbgraph.front_end.step_track import StepTrack

SURE = GraphConfig(sigma_mag_rad=0.09)  # as of a wearable
YAW = laps(3, side=10)
JUMP_UT = (15.0, -10.0)


def batch(track: StepTrack) -> Smoothed:
    return smooth(track, seed_of(track, np.concatenate((YAW[:1], YAW))), SURE, SolverConfig())


def window_of(track: StepTrack, window_steps: int, *judged: int) -> IsamWindow:
    """After the walk, whose iron was asked for at some breadcrumbs."""
    return walked(track, EXACT.model_copy(update={"window_steps": window_steps}), judged=judged, config=SURE)


def apart(window: IsamWindow, smoothed: Smoothed) -> tuple[float, float]:
    """How far the latest breadcrumb is from the batch smoother's: metres, radians."""
    node, t = window.refresh()[-1], smoothed.trajectory
    yaw_off = float(wrap_angle(np.array(node.yaw_rad - t.yaw_rad[-1])))
    return float(np.hypot(node.x_m - t.x_m[-1], node.y_m - t.y_m[-1])), abs(yaw_off)


@pytest.mark.parametrize("window_steps", [100, 40])  # which never moves, and at breadcrumbs 79 and 119
@pytest.mark.parametrize("iron_ut", [(24.0, 0.0), (-9.0, 13.0), (1.0, -1.0)])
def test_online_the_iron_is_the_batch_smoothers(iron_ut: tuple[float, float], window_steps: int) -> None:
    track = magnetised(YAW, iron_ut)
    window, smoothed = window_of(track, window_steps, 40, 60), batch(track)
    assert window.first == (0 if window_steps == 100 else 80)
    off_m, off_rad = apart(window, smoothed)
    assert off_m < 0.08
    assert off_rad < 0.01


@pytest.mark.parametrize("window_steps", [100, 40])
def test_a_jump_is_taken_out_from_where_it_was_seen_on(window_steps: int) -> None:
    iron_ut = np.where(np.arange(len(YAW))[:, None] >= 59, JUMP_UT, (0.0, 0.0))
    track = magnetised(YAW, iron_ut, jump=(60, *JUMP_UT))
    window, smoothed = window_of(track, window_steps, 75, 90, 100), batch(track)
    assert smoothed.device is not None
    assert smoothed.device.stretch_starts.tolist() == [0, 60]
    assert smoothed.device.iron_ut[1] == pytest.approx((*JUMP_UT, LEVEL_UT), abs=0.3)
    off_m, off_rad = apart(window, smoothed)
    assert off_m < 0.01
    assert off_rad < 1e-3
    unasked = apart(window_of(track, window_steps), smoothed)
    assert unasked[0] > 0.3
    assert unasked[1] > 0.05
