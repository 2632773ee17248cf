"""Faults of sensors and clocks, by name, and what comes of each today."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from fbgraph.core.units import DEGREE_RAD
from support.broken_tables import (
    ACC,
    DAY_MS,
    GYRO,
    MAG,
    PRESSURE,
    Change,
    T,
    Table,
    acc_late,
    at_5_khz,
    clipped,
    clock_hops,
    clock_jitter,
    clock_jump,
    clock_of,
    clock_restart,
    compass_at_random,
    every_nth,
    frozen,
    header_says,
    lying_on_a_table,
    noisy,
    offset,
    pressure_drift,
    rows_chosen,
    scaled,
    shuffled,
    some_show,
    swapped,
    value_from,
    without_gravity,
    without_minute,
)

SOUND, WIDE, DOUBTFUL, WITHHELD, REFUSED = "sound", "wide", "doubtful", "withheld", "refused"
UNNAMED, SILENT = "unnamed", "silent"
"""What comes of a fault: a walk called sound that is as good as without it, or worse but within four of its own sigma;
one that is doubted or withheld, and why; none, and why. And what must not be: a walk that is doubted for another reason
alone, or that is called sound and is further off than that."""


@dataclass(frozen=True)
class Fault:
    """What a device did wrong.

    Attributes:
        name: what it is called.
        outcome: what comes of it.
        told_by: the words, one of which names what is wrong.
        change: spoils the rows.
    """

    name: str
    outcome: str
    told_by: tuple[str, ...]
    change: Change


def faulty(table: Table, fault: Fault) -> Table:
    """The log of a device with this fault; the same each time."""
    spoiled = table.copy()
    fault.change(spoiled, np.random.default_rng(list(fault.name.encode())))
    return spoiled


_A, _G, _M = ("accelerometer",), ("gyroscope",), ("magnetometer", "magnetic", "compass")
_P, _T = ("barometer", "pressure", "altitude"), ("time", "clock", "gap", "runs at")
_AG, _AGM = _A + _G, _A + _G + _M

FAULTS = (
    Fault("acc 30 % empty", SOUND, _A, some_show(ACC, 0.3, np.nan)),
    Fault("acc 90 % empty", DOUBTFUL, _A, some_show(ACC, 0.9, np.nan)),
    Fault("acc 5 % Inf", SOUND, _A, some_show(ACC, 0.05, np.inf)),
    Fault("acc 2 % 1e30", SOUND, _A, some_show(ACC, 0.02, 1e30)),
    Fault("acc frozen from 1/3", DOUBTFUL, _A, frozen(ACC, 1 / 3)),
    Fault("acc frozen 1/3 to 1/2", DOUBTFUL, _A, frozen(ACC, 1 / 3, 1 / 2)),
    Fault("acc missing from 1/3", DOUBTFUL, _A, value_from(ACC, np.nan, 1 / 3)),
    Fault("acc zero from 1/3", REFUSED, _A, value_from(ACC, 0.0, 1 / 3)),
    Fault("gyro 30 % empty", SOUND, _G, some_show(GYRO, 0.3, np.nan)),
    Fault("gyro 90 % empty", DOUBTFUL, _G, some_show(GYRO, 0.9, np.nan)),
    Fault("gyro 5 % Inf", SOUND, _G, some_show(GYRO, 0.05, np.inf)),
    Fault("gyro 2 % 1e30", SOUND, _G, some_show(GYRO, 0.02, 1e30)),
    Fault("gyro frozen from 1/3", WITHHELD, _G, frozen(GYRO, 1 / 3)),
    Fault("gyro frozen 1/3 to 1/2", DOUBTFUL, _G, frozen(GYRO, 1 / 3, 1 / 2)),
    Fault("gyro missing from 1/3", DOUBTFUL, _G, value_from(GYRO, np.nan, 1 / 3)),
    Fault("gyro zero from 1/3", DOUBTFUL, _G, value_from(GYRO, 0.0, 1 / 3)),
    Fault("mag 30 % empty", SOUND, _M, some_show(MAG, 0.3, np.nan)),
    Fault("mag 90 % empty", SOUND, _M, some_show(MAG, 0.9, np.nan)),
    Fault("mag 5 % Inf", SOUND, _M, some_show(MAG, 0.05, np.inf)),
    Fault("mag 2 % 1e30", SOUND, _M, some_show(MAG, 0.02, 1e30)),
    Fault("mag frozen from 1/3", DOUBTFUL, _M, frozen(MAG, 1 / 3)),
    Fault("mag frozen 1/3 to 1/2", DOUBTFUL, _M, frozen(MAG, 1 / 3, 1 / 2)),
    Fault("mag missing from 1/3", SOUND, _M, value_from(MAG, np.nan, 1 / 3)),
    Fault("mag zero from 1/3", DOUBTFUL, _M, value_from(MAG, 0.0, 1 / 3)),
    Fault("p 30 % empty", SOUND, _P, some_show(PRESSURE, 0.3, np.nan)),
    Fault("p 90 % empty", SOUND, _P, some_show(PRESSURE, 0.9, np.nan)),
    Fault("p 5 % Inf", SOUND, _P, some_show(PRESSURE, 0.05, np.inf)),
    Fault("p 2 % 1e30", SOUND, _P, some_show(PRESSURE, 0.02, 1e30)),
    Fault("p frozen from 1/3", SOUND, _P, frozen(PRESSURE, 1 / 3)),
    Fault("p frozen 1/3 to 1/2", SOUND, _P, frozen(PRESSURE, 1 / 3, 1 / 2)),
    Fault("p missing from 1/3", SOUND, _P, value_from(PRESSURE, np.nan, 1 / 3)),
    Fault("p zero from 1/3", SOUND, _P, value_from(PRESSURE, 0.0, 1 / 3)),
    Fault("acc 1 % spikes 15 g", DOUBTFUL, _A, some_show(ACC, 0.01, 15.0)),
    Fault("gyro 1 % spikes 1900 dps", WITHHELD, _G, some_show(GYRO, 0.01, 1900.0)),
    Fault("gyro 0.1 % spikes 1900 dps", DOUBTFUL, _G, some_show(GYRO, 0.001, 1900.0)),
    Fault("mag 5 % spikes 3000 uT", DOUBTFUL, _M, some_show(MAG, 0.05, 3000.0)),
    Fault("p 5 % spikes 500 hPa", SOUND, _P, some_show(PRESSURE, 0.05, 500.0)),
    Fault("p 30 % spikes 500 hPa", SOUND, _P, some_show(PRESSURE, 0.3, 500.0)),
    Fault("all frozen from 1/3", DOUBTFUL, _AG, frozen(slice(1, 11), 1 / 3)),
    Fault("1 row", REFUSED, _T, rows_chosen(lambda count, rng: np.arange(1))),
    Fault("20 Hz", SOUND, _T, every_nth(5)),
    Fault("10 Hz", WITHHELD, _T, every_nth(10)),
    Fault("5 Hz", WITHHELD, _T, every_nth(20)),
    Fault("2 Hz", WITHHELD, _T, every_nth(50)),
    Fault("5 kHz (t_us)", SOUND, _T, at_5_khz(whole_ms=False)),
    Fault("5 kHz in ms", SOUND, _T, at_5_khz(whole_ms=True)),
    Fault("30 min gap", SOUND, _T, clock_jump(30 * 60e3)),
    Fault("55 min gap", SOUND, _T, clock_jump(55 * 60e3)),
    Fault("70 min gap", SOUND, _T, clock_jump(70 * 60e3)),
    Fault("60 s cut", WIDE, _T, without_minute),
    Fault("clock +1 day", SOUND, _T, clock_jump(DAY_MS)),
    Fault("clock -1 day (epoch ms)", SOUND, _T, clock_jump(-DAY_MS, epoch_ms=1.7e12)),
    Fault("clock restarts at 0", DOUBTFUL, _T, clock_of(clock_restart)),
    Fault("millis wrap 2^32", SOUND, _T, clock_of(lambda t_ms, rng: (t_ms + 2.0**32 - 50e3) % 2.0**32)),
    Fault("clock +3 s jump", SOUND, _T, clock_jump(3e3)),
    Fault("clock +0.6 s jumps 20 times", SOUND, _T, clock_of(clock_hops)),
    Fault("clock -0.5 s jump", DOUBTFUL, _T, clock_jump(-0.5e3)),
    Fault("clock -3 s jump", DOUBTFUL, _T, clock_jump(-3e3)),
    Fault("clock runs 1.2x", DOUBTFUL, _T, scaled(T, 1.2)),
    Fault("clock runs 2x", DOUBTFUL, _T, scaled(T, 2.0)),
    Fault("clock runs 0.5x", DOUBTFUL, _T, scaled(T, 0.5)),
    Fault("jitter 30 ms", SOUND, _T, clock_of(clock_jitter)),
    Fault("clock in 100 ms ticks", SOUND, _T, clock_of(lambda t_ms, rng: t_ms // 100.0 * 100.0)),
    Fault("p in Pa named hpa", SOUND, _P, scaled(PRESSURE, 100.0)),
    Fault("p in kPa named hpa", SOUND, _P, scaled(PRESSURE, 0.1)),
    Fault("mag in gauss named ut", SOUND, _M, scaled(MAG, 0.01)),
    Fault("mag in nT named ut", SOUND, _M, scaled(MAG, 1e3)),
    Fault("gyro rad/s named dps", SOUND, _G, scaled(GYRO, DEGREE_RAD)),
    Fault("gyro mdps named dps", SOUND, _G, scaled(GYRO, 1e3)),
    Fault("gyro dps named rads", SOUND, _G, header_says("_dps", "_rads")),
    Fault("acc ms2 named g", SOUND, _A, scaled(ACC, 9.80665)),
    Fault("acc mg named g", SOUND, _A, scaled(ACC, 1e3)),
    Fault("acc g named ms2", SOUND, _A, header_says("_g,", "_ms2,")),
    Fault("acc x0.8", DOUBTFUL, _A, scaled(ACC, 0.8)),
    Fault("acc x1.3", DOUBTFUL, _A, scaled(ACC, 1.3)),
    Fault("gyro x0.5", DOUBTFUL, _G, scaled(GYRO, 0.5)),
    Fault("gyro x2", DOUBTFUL, _G, scaled(GYRO, 2.0)),
    Fault("acc x2 (range bit)", DOUBTFUL, _A, scaled(ACC, 2.0)),
    Fault("acc x0.5 (range bit)", DOUBTFUL, _A, scaled(ACC, 0.5)),
    Fault("acc x<->y", DOUBTFUL, _A, swapped((1, 2))),
    Fault("acc y<->z", WITHHELD, _A, swapped((2, 3))),
    Fault("acc all negated", SOUND, _A, scaled(ACC, -1.0)),
    Fault("gyro x<->y", SOUND, _G, swapped((4, 5))),
    Fault("gyro all negated", SOUND, _G, scaled(GYRO, -1.0)),
    Fault("gyro z negated", SOUND, _G, scaled(GYRO, 1.0, 1.0, -1.0)),
    Fault("mag x<->y", SOUND, _M, swapped((7, 8))),
    Fault("mag all negated", DOUBTFUL, _M, scaled(MAG, -1.0)),
    Fault("mag z negated", SOUND, _M, scaled(MAG, 1.0, 1.0, -1.0)),
    Fault("acc<->gyro columns", REFUSED, _AG, swapped((1, 4), (2, 5), (3, 6))),
    Fault("all x<->y (mounted turned)", DOUBTFUL, (*_AGM, "mount"), swapped((1, 2), (4, 5), (7, 8))),
    Fault("acc clip 2 g", SOUND, _A, clipped(ACC, 2.0)),
    Fault("acc clip 1.2 g", DOUBTFUL, _A, clipped(ACC, 1.2)),
    Fault("acc clip 1.0 g", DOUBTFUL, _A, clipped(ACC, 1.0)),
    Fault("gyro clip 250 dps", SOUND, _G, clipped(GYRO, 250.0)),
    Fault("gyro clip 50 dps", DOUBTFUL, _G, clipped(GYRO, 50.0)),
    Fault("gyro clip 20 dps", DOUBTFUL, _G, clipped(GYRO, 20.0)),
    Fault("gyro z bias 2 dps", SOUND, _G, offset(slice(6, 7), 2.0)),
    Fault("gyro z bias 5 dps", DOUBTFUL, _G, offset(slice(6, 7), 5.0)),
    Fault("gyro z bias 20 dps", DOUBTFUL, _G, offset(slice(6, 7), 20.0)),
    Fault("gyro z bias 60 dps", DOUBTFUL, _G, offset(slice(6, 7), 60.0)),
    Fault("gyro z bias 5 dps from mid", WIDE, _G, offset(slice(6, 7), 5.0, 1 / 2)),
    Fault("gyro xyz bias 5 dps from mid", DOUBTFUL, _G, offset(GYRO, 5.0, 1 / 2)),
    Fault("gyro xyz bias 20 dps from mid", WITHHELD, _G, offset(GYRO, 20.0, 1 / 2)),
    Fault("mag hard iron 200 uT", DOUBTFUL, _M, offset(slice(7, 8), 200.0)),
    Fault("mag hard iron 200 uT from mid", DOUBTFUL, _M, offset(slice(7, 8), 200.0, 1 / 2)),
    Fault("mag hard iron 60 uT from mid", SOUND, _M, offset(slice(7, 8), 60.0, 1 / 2)),
    Fault("p +10 hPa from mid", SOUND, _P, offset(PRESSURE, 10.0, 1 / 2)),
    Fault("p drift 20 hPa", DOUBTFUL, _P, pressure_drift),
    Fault("p noise 2 hPa", SOUND, _P, noisy(PRESSURE, 2.0)),
    Fault("mag random direction", DOUBTFUL, _M, compass_at_random),
    Fault("acc gravity removed", REFUSED, _A, without_gravity),
    Fault("acc 0.2 s late", SOUND, _A, acc_late),
    Fault("rows shuffled within 1 s", SOUND, _T, rows_chosen(shuffled)),
    Fault("rows reversed", REFUSED, _T, rows_chosen(lambda count, rng: np.arange(count)[::-1])),
    Fault("log twice (appended)", DOUBTFUL, _T, rows_chosen(lambda count, rng: np.tile(np.arange(count), 2))),
    Fault("every row twice", SOUND, _T, rows_chosen(lambda count, rng: np.repeat(np.arange(count), 2))),
    Fault("acc noise 1 g", REFUSED, _A, noisy(ACC, 1.0)),
    Fault("acc noise 5 g", REFUSED, _A, noisy(ACC, 5.0)),
    Fault("gyro noise 100 dps", DOUBTFUL, _G, noisy(GYRO, 100.0)),
    Fault("gyro noise 1000 dps", REFUSED, _G, noisy(GYRO, 1000.0)),
    Fault("no walk: 2 Hz vibration on a table, 60 s", REFUSED, _A, lying_on_a_table(shake_g=0.3, noise_g=0.002)),
    Fault("no walk: white noise, 60 s", REFUSED, _A, lying_on_a_table(shake_g=0.0, noise_g=3.0)),
)
