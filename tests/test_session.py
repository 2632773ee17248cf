"""A walk in progress."""

from pathlib import Path

import numpy as np
import pytest

from fbgraph.core.config import load_config
from fbgraph.core.errors import ConfigError
from fbgraph.core.sensor_log import SensorLog, Stream
from fbgraph.session import cut_log, follow_source


@pytest.mark.parametrize("chunk_s", [0.1, 0.03, 0.7, 1e9])
def test_a_replayed_log_is_the_log(chunk_s: float) -> None:
    """Cut into pieces, no sample is lost or doubled, also where it lies on a cut."""
    t_s = np.round(np.arange(0.0, 60.0, 0.01), 2)
    acc = Stream(t_s, np.tile(t_s[:, None], 3))
    mag = Stream(t_s[::7] + 1.0, np.tile(t_s[::7, None], 3))
    log = SensorLog(name="x", format="x", t0_s=0.0, acc=acc, gyro=acc, mag=mag)
    joined = SensorLog.concatenate([piece for piece, _ in cut_log(log, chunk_s, np.inf, lambda: False)])
    for name in ("acc", "gyro", "mag"):
        np.testing.assert_array_equal(getattr(joined, name).t_s, getattr(log, name).t_s)


def test_a_recording_that_cannot_begin_is_told_in_one_line(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def full(path: Path) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("fbgraph.session.RawRecorder", full)
    with pytest.raises(ConfigError, match=r"raw\.csv: cannot write there: No space left on device"):
        follow_source([b"t_ms,ax_g\n"], tmp_path, load_config("m5stickc"))
