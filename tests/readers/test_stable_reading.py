"""What is decided of a real log is decided of its first twenty seconds of walking as well."""

from pathlib import Path

import numpy as np
import pytest

from fbgraph.columns.clock_times import clock_ns
from fbgraph.readers.decide import decide
from fbgraph.tables import read_tables

LOGS = {  # where the first twenty seconds of walking end
    "ridi/dan_bag2.csv.gz": 24.0,
    "formats/m5stickcplus_kjwu/circle.csv": 20.0,
    "formats/phyphox_android_nju": 20.0,
    "formats/sensorlogger_ios_excerpt": 20.0,
    "ipin21/eight": 25.0,
}


@pytest.mark.parametrize("name", LOGS)
def test_a_cut_log_has_the_same_layout(name: str, shared_data: Path) -> None:
    tables = read_tables(shared_data / name).tables
    whole = decide(tables, name)
    cut = list(tables)
    for i, clock in whole.clocks.items():
        t_ns = clock_ns(tables[i], clock)
        cut[i] = tables[i].rows(np.flatnonzero(t_ns <= t_ns[0] + int(LOGS[name] * 1e9)))
        assert len(cut[i]) <= len(tables[i])
    assert decide(cut, name).layout == whole.layout
