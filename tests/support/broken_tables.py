"""A walk's log as a table, and what broken sensors and clocks do to it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.random import Generator

from fbgraph.columns.column_names import CANONICAL
from fbgraph.core.geometry import FloatArray, IntArray

T, ACC, GYRO, MAG, PRESSURE, TRUE_T = slice(0, 1), slice(1, 4), slice(4, 7), slice(7, 10), slice(10, 11), slice(11, 12)
_STEP_MS = 10.0
DAY_MS = 86_400_000.0


@dataclass
class Table:
    """A log's rows.

    Attributes:
        header: as the file has it.
        rows: (N, 12) t, acc, gyro, mag, pressure in the header's units, nan where a field is empty; last the true time
            in milliseconds, which is not written.
    """

    header: str
    rows: FloatArray

    def copy(self) -> Table:
        return Table(self.header, self.rows.copy())

    def text(self) -> str:
        """The log."""
        line = "%.15g" + ",%.9g" * 10 + ",,\n"
        lines = [line % tuple(row) for row in self.rows[:, :11].tolist()]
        return self.header + "\n" + "".join(lines).replace("nan", "")

    @property
    def shown_s(self) -> FloatArray:
        """(N,) the rows' times as a reader has them: where the clock restarts they go on."""
        t_s = self.rows[:, 0] / (1e6 if self.header.startswith("t_us") else 1e3)
        steps = np.diff(t_s)
        steps[steps < -1.0] = _STEP_MS / 1e3
        return np.asarray(t_s[0] + np.concatenate(([0.0], np.cumsum(steps))))

    @property
    def true_s(self) -> FloatArray:
        """(N,) when they really were."""
        return np.asarray(self.rows[:, 11] / 1e3)

    def part(self, start: float, end: float = 1.0) -> slice:
        """The rows of a part of the log; 0 is its beginning, 1 its end."""
        return slice(int(start * len(self.rows)), int(end * len(self.rows)))

    def held(self) -> FloatArray:
        """(N, 12) the rows with every empty field filled by the last value before it, or else the next."""
        filled = self.rows.copy()
        for column in filled.T:
            there = np.flatnonzero(np.isfinite(column))
            before = np.searchsorted(there, np.arange(len(column)), side="right") - 1
            column[:] = column[there[np.maximum(before, 0)]]
        return filled


Change = Callable[[Table, Generator], None]


def table_of(path: Path) -> Table:
    """The rows of a canonical log."""
    rows = np.genfromtxt(path, delimiter=",", skip_header=1, usecols=range(11))
    return Table(CANONICAL, np.column_stack((rows, rows[:, 0])))


def _share(table: Table, share: float, rng: Generator) -> IntArray:
    return np.flatnonzero(rng.random(len(table.rows)) < share)


def some_show(of: slice, share: float, value: float) -> Change:
    """Some rows show a value; fields that are empty stay so."""

    def change(table: Table, rng: Generator) -> None:
        hit = _share(table, share, rng)
        there = np.isfinite(table.rows[hit, of])
        table.rows[hit, of] = np.where(there, value, np.nan)

    return change


def value_from(of: slice, value: float, start: float, end: float = 1.0) -> Change:
    """All rows of a part show a value; fields that are empty stay so."""

    def change(table: Table, rng: Generator) -> None:
        part = table.part(start, end)
        table.rows[part, of] = np.where(np.isfinite(table.rows[part, of]), value, np.nan)

    return change


def frozen(of: slice, start: float, end: float = 1.0) -> Change:
    def change(table: Table, rng: Generator) -> None:
        part = table.part(start, end)
        last = table.held()[part.start, of]
        table.rows[part, of] = np.where(np.isfinite(table.rows[part, of]), last, np.nan)

    return change


def offset(of: slice, amount: float, start: float = 0.0) -> Change:
    def change(table: Table, rng: Generator) -> None:
        table.rows[table.part(start), of] += amount

    return change


def scaled(of: slice, *factors: float) -> Change:
    """By one factor, or by one for each axis."""

    def change(table: Table, rng: Generator) -> None:
        table.rows[:, of] *= factors

    return change


def swapped(*pairs: tuple[int, int]) -> Change:
    def change(table: Table, rng: Generator) -> None:
        for a, b in pairs:
            table.rows[:, [a, b]] = table.rows[:, [b, a]]

    return change


def clipped(of: slice, limit: float) -> Change:
    def change(table: Table, rng: Generator) -> None:
        table.rows[:, of] = np.clip(table.rows[:, of], -limit, limit)

    return change


def noisy(of: slice, sigma: float) -> Change:
    def change(table: Table, rng: Generator) -> None:
        table.rows[:, of] += rng.normal(0.0, sigma, table.rows[:, of].shape)

    return change


def header_says(old: str, new: str) -> Change:
    """The header tells another unit."""

    def change(table: Table, rng: Generator) -> None:
        table.header = table.header.replace(old, new)

    return change


def pressure_drift(table: Table, rng: Generator) -> None:
    table.rows[:, PRESSURE] += np.linspace(0.0, 20.0, len(table.rows))[:, None]


def compass_at_random(table: Table, rng: Generator) -> None:
    directions = rng.normal(size=(len(table.rows), 3))
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    table.rows[:, MAG] = directions * np.linalg.norm(table.rows[:, MAG], axis=1, keepdims=True)


def without_gravity(table: Table, rng: Generator) -> None:
    table.rows[:, ACC] -= table.rows[:, ACC].mean(axis=0)


def acc_late(table: Table, rng: Generator) -> None:
    table.rows[20:, ACC] = table.rows[:-20, ACC].copy()


def rows_chosen(chosen: Callable[[int, Generator], IntArray], hold: bool = False) -> Change:
    """These rows, in this order; where rows are left out the slow sensors are read again."""

    def change(table: Table, rng: Generator) -> None:
        table.rows = (table.held() if hold else table.rows)[chosen(len(table.rows), rng)]

    return change


def every_nth(nth: int) -> Change:
    return rows_chosen(lambda count, rng: np.arange(0, count, nth), hold=True)


def shuffled(count: int, rng: Generator) -> IntArray:
    return np.lexsort((rng.random(count), np.arange(count) // 100))


def without_minute(table: Table, rng: Generator) -> None:
    table.rows = np.delete(table.rows, np.s_[700:6700], axis=0)


def at_5_khz(whole_ms: bool) -> Change:
    """The walk's beginning at 5 kHz."""

    def change(table: Table, rng: Generator) -> None:
        held = table.held()[:2500]
        t_ms = np.arange(held[0, 0], held[-1, 0], 0.2)
        table.rows = np.column_stack([np.interp(t_ms, held[:, 0], column) for column in held.T])
        table.rows[:, 0] = np.floor(t_ms) if whole_ms else np.round(t_ms * 1e3)
        table.header = table.header if whole_ms else table.header.replace("t_ms", "t_us")

    return change


def clock_of(of: Callable[[FloatArray, Generator], FloatArray]) -> Change:
    """Another time, in whole milliseconds, for every row."""

    def change(table: Table, rng: Generator) -> None:
        table.rows[:, 0] = np.round(of(table.rows[:, 0], rng))

    return change


def clock_jump(by_ms: float, epoch_ms: float = 0.0) -> Change:
    """The clock is set once, in the middle."""
    return clock_of(lambda t_ms, rng: t_ms + epoch_ms + by_ms * (np.arange(len(t_ms)) >= len(t_ms) // 2))


def clock_restart(t_ms: FloatArray, rng: Generator) -> FloatArray:
    return np.asarray(t_ms - t_ms[len(t_ms) // 2] * (np.arange(len(t_ms)) >= len(t_ms) // 2))


def clock_hops(t_ms: FloatArray, rng: Generator) -> FloatArray:
    return np.asarray(t_ms + 600.0 * np.floor(np.linspace(0.0, 20.99, len(t_ms))))


def clock_jitter(t_ms: FloatArray, rng: Generator) -> FloatArray:
    return np.maximum.accumulate(t_ms + rng.uniform(0.0, 30.0, len(t_ms)))


def lying_on_a_table(shake_g: float, noise_g: float) -> Change:
    """A minute on a table: shaken twice a second, or by noise."""

    def change(table: Table, rng: Generator) -> None:
        table.rows = table.rows[:6000]
        rows = len(table.rows)
        shaken = shake_g * np.sin(4.0 * np.pi * table.rows[:, 0] / 1e3)
        table.rows[:, ACC] = np.array([0.0, 0.0, 1.0]) + shaken[:, None] * [0.0, 0.0, 1.0]
        table.rows[:, ACC] += rng.normal(0.0, noise_g, (rows, 3))
        table.rows[:, GYRO] = 0.02 * rng.normal(size=(rows, 3))
        for still in (MAG, PRESSURE):
            table.rows[:, still] = table.held()[0, still] + 0.0 * table.rows[:, still]
        table.rows[:, TRUE_T] = table.rows[0, 11]  # nobody went anywhere

    return change
