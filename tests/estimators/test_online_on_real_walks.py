"""Online on real walks: at the end what the batch smoother says, before it better than the EKF."""

from pathlib import Path

import numpy as np
import pytest
from support.walking import differences, feed

from fbgraph.core.aids import Told
from fbgraph.core.config import load_config
from fbgraph.estimators.online_smoother import OnlineSmoother
from fbgraph.pipeline import reconstruct
from fbgraph.readers import preset, read_log
from fbgraph.run.metrics import score


def some_logs(shared_data: Path) -> list[Path]:
    """All of the museum, and some of the shopping centre."""
    indoor = sorted((shared_data / "indoor-location" / "site1").rglob("*.txt.gz"))
    return [*sorted((shared_data / "ipin2023").glob("*.gz")), *indoor[::8]]


@pytest.mark.parametrize("anchored", [False, True])
def test_the_end_is_the_batch_smoothers(shared_data: Path, anchored: bool) -> None:
    paths = some_logs(shared_data)
    assert len(paths) == 18
    scores = []
    for path in paths[::2] if anchored else paths:
        log_file = read_log(path)
        log, truth = log_file.log, log_file.truth
        assert truth is not None
        config = load_config(preset(log.format))
        told = Told(anchors=truth.select(slice(0, None, 3)) if anchored else None)
        batch = reconstruct(log, config, told)
        smoother = OnlineSmoother(config, told.aids(log.t0_s))
        feed(smoother, log, 0.7)
        distance_m, yaw_deg = differences(smoother.finish().trajectory, batch.smoothed.trajectory)
        assert distance_m < 0.05, path.name
        assert yaw_deg < 0.3, path.name
        scores.append([score(t, truth, log.t0_s).rmse_m for t in (smoother.causal, batch.trajectories["ekf"])])
    online_m, ekf_m = np.mean(scores, axis=0)
    assert anchored or online_m < ekf_m
