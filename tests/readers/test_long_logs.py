"""A log of a quarter of an hour is judged by pieces of it, as all of it would be judged."""

from dataclasses import replace
from functools import cache

import numpy as np

from fbgraph.core.geometry import FloatArray
from fbgraph.core.sensor_log import SensorLog
from fbgraph.physics.pieces import Pieces
from fbgraph.physics.sensor_axes import CHIPS
from fbgraph.readers.decide import decide
from fbgraph.readers.reading import Reading
from fbgraph.simulator.routes import load_route
from fbgraph.simulator.simulate import simulate
from fbgraph.simulator.simulate_options import SimulateOptions
from fbgraph.tables.table import Column, Table

SECOND_NS = 1_000_000_000


@cache
def walk() -> SensorLog:
    return simulate(load_route("square"), SimulateOptions(duration_s=900.0)).log


def table_of(name: str, axes: str, t_s: FloatArray, values: FloatArray) -> Table:
    columns = [Column("t_ms", "", np.round(1e3 * t_s).astype(np.int64))]
    columns += [Column(axis, "", column.copy()) for axis, column in zip(axes.split(","), values.T, strict=True)]
    return Table(name, name, tuple(columns))


def tables() -> list[Table]:
    log = walk()
    return [
        table_of("acc", "ax,ay,az", log.acc.t_s, log.acc.values),
        table_of("gyro", "gx,gy,gz", log.gyro.t_s, log.gyro.values),
        table_of("mag", "mx,my,mz", log.mag.t_s, log.mag.values),
        table_of("pressure", "p_hpa", log.pressure.t_s, log.pressure.values),
    ]


def turned(table: Table, told: tuple[str, ...]) -> Table:
    """The table of a sensor along whose columns these axes of the device are."""
    columns = list(table.columns[1:])
    for i, axis in enumerate(told):
        source = table.columns[1 + "xyz".index(axis[-1])].values
        columns[i] = replace(columns[i], values=-source if axis[0] == "-" else source)
    return replace(table, columns=(table.columns[0], *columns))


def decided(some: list[Table]) -> Reading:
    return decide(some, "walk")


def test_the_axes_of_a_chip_are_found_in_pieces_as_in_all() -> None:
    acc, gyro, mag, pressure = tables()
    chip = CHIPS["ICM-20948"]
    long = decided([acc, gyro, turned(mag, chip), pressure]).layout
    assert long.mag is not None
    assert long.mag.axes == chip
    short = [table.rows(table.columns[0].values <= 300_000) for table in (acc, gyro, turned(mag, chip), pressure)]
    assert decided(short).layout == long


def test_a_mirrored_gyroscope_is_found_in_pieces() -> None:
    acc, gyro, mag, pressure = tables()
    layout = decided([acc, turned(gyro, ("x", "y", "-z")), mag, pressure]).layout
    assert layout.gyro.axes == ("x", "y", "-z")
    assert layout.acc.axes == ("x", "y", "z")


def test_a_barometer_that_speaks_once_a_minute_is_heard() -> None:
    acc, gyro, mag, pressure = tables()
    rows = np.arange(len(pressure) // 60, len(pressure), len(pressure) // 20)  # each between two pieces
    layout = decided([acc, gyro, mag, pressure.rows(rows)]).layout
    assert layout.pressure is not None
    assert layout.pressure.unit == "hPa"


def test_sensors_are_judged_on_one_clock() -> None:
    """Of a magnetometer that begins two seconds late, what it says then is held against the turns of then."""
    acc, gyro, mag, pressure = (table.rows(table.columns[0].values <= 300_000) for table in tables())
    late = mag.rows(mag.columns[0].values >= 7_300)
    judged = decided([acc, gyro, late, pressure]).judged.mag
    assert judged is not None
    assert judged.sure
    assert judged.text == "magnetic field: no unit in its name, 45.3, 44.4 without the device's iron: taken as µT"


def test_pieces_are_as_many_in_a_row_as_in_any_other() -> None:
    t_ns = np.arange(0, 3600 * SECOND_NS, 10_000_000)
    pieces = Pieces.of(t_ns)
    assert pieces is not None
    assert np.diff(pieces.starts_ns).tolist() == [225 * SECOND_NS] * 15
    rows, moved_ns = pieces.rows(t_ns)
    assert len(rows) == 16 * 1000
    assert moved_ns.tolist()[:1001:250] == [0, 2_500_000_000, 5_000_000_000, 7_500_000_000, 12 * SECOND_NS]
    assert (np.diff(rows) == np.where(np.diff(moved_ns) == 10_000_000, 1, 21_501)).all()


def test_rows_out_of_order_are_in_the_same_pieces() -> None:
    t_ns = np.arange(0, 900 * SECOND_NS, 20_000_000)
    mixed = np.random.default_rng(2).permutation(len(t_ns))
    pieces, of_mixed = Pieces.of(t_ns), Pieces.of(t_ns[mixed])
    assert pieces is not None
    assert of_mixed is not None
    assert of_mixed.starts_ns.tolist() == pieces.starts_ns.tolist()
    rows, moved_ns = pieces.rows(t_ns)
    found, found_ns = pieces.rows(t_ns[mixed])
    order = np.argsort(mixed[found])
    assert mixed[found][order].tolist() == rows.tolist()
    assert found_ns[order].tolist() == moved_ns.tolist()


def test_neither_a_garbled_time_nor_a_long_pause_makes_a_log_long_or_short() -> None:
    t_ns = np.arange(0, 300 * SECOND_NS, 20_000_000)
    assert Pieces.of(t_ns) is None
    t_ns[7000] = 3 * 10**18
    assert Pieces.of(t_ns) is None
    paused = np.concatenate((np.arange(0, 400, 0.02), 86_400.0 + np.arange(0, 400, 0.02)))
    pieces = Pieces.of((paused * SECOND_NS).astype(np.int64))
    assert pieces is not None
    assert len(pieces.starts_ns) == 16
    assert np.count_nonzero(pieces.starts_ns < 500 * SECOND_NS) == 8
