"""Units of sensors by what they must show: gravity, a walker's turns, an atmosphere.

Pure functions of samples; what a column is called comes in only as the factor that its name tells, if it tells one.
Names propose, physics decides: a name is kept unless physics contradicts it clearly, and then that is said.
"""

from __future__ import annotations

import numpy as np

from fbgraph.core.geometry import FloatArray
from fbgraph.core.sensor_log import Stream
from fbgraph.core.units import DEGREE_RAD, STANDARD_GRAVITY_M_S2
from fbgraph.physics.judgement import Judgement
from fbgraph.physics.sensor_axes import Turning
from fbgraph.physics.turning import gain

_COUNTS_A_G = (16384, 8192, 4096, 2048, 1024, 512, 256)
_COUNTS_A_DPS = (16.4, 32.8, 65.5, 131.0)  # InvenSense's, ±2000 to ±250 °/s
_BLOCK_S = 2.0  # some four steps
_NEAR = 1.2  # a factor by which sensors and walkers are off at most
_FAR = 1.6  # from which a name is contradicted
_NO_GRAVITY_SHARE = 0.3  # of the acceleration's power that does not change within a block; walks: 0.55 or more
_NO_GRAVITY = 0.3  # g, whatever the unit
_FASTEST_RAD_S = 10.0  # nobody turns like this for a tenth of a walk
_SLOWEST_RAD_S = 0.08  # whoever walks tilts the device faster a tenth of the time
_MOVING_M_S2 = 0.8  # of the acceleration's norm, one sigma
_SURE_SIGMAS, _AGAINST_NAME_SIGMAS = 2.0, 4.0
_ATMOSPHERE_HPA = (300.0, 1120.0)
_HIGH_HPA = 540.0  # above 5 km few walk
_SPREAD_HPA = 60.0  # nobody climbs 500 m in a walk


def judge_accelerometer(acc: Stream, named_scale: float | None = None) -> Judgement:
    """Unit of an accelerometer by gravity, 9.80665 m/s² (CODATA), and whether gravity is there at all.

    Gravity is what is left over blocks of some steps; its size is read where the device is quietest.

    Args:
        acc: (N, 3) as the file has it.
        named_scale: factor to m/s² that its name tells.
    """
    means, norms, squares = _blocks(acc)
    if not len(norms):
        scale = named_scale or 1.0
        return Judgement(scale, _acc_unit(scale), "name" if named_scale else "assumed", False, 0.0)
    calm = squares <= np.percentile(squares, 95)  # one garbled number may outweigh all the others
    share = float((means[calm] ** 2).sum() / max(float(squares[calm].sum()), 1e-30))
    restless = squares - norms**2
    quiet = restless <= np.percentile(restless, 25)
    size = float(np.median(norms[quiet]))
    units = _acc_units(_whole(acc.values))
    seen = f"{size:.4g} at rest"
    nearest = min(units, key=lambda unit: _factor(size * units[unit]))
    fits = _factor(size * units[nearest]) <= _NEAR
    small = size * (named_scale or STANDARD_GRAVITY_M_S2) < _NO_GRAVITY * STANDARD_GRAVITY_M_S2
    if share < _NO_GRAVITY_SHARE or (small and not fits):
        text = "the accelerometer has gravity removed: nothing tells which way is down; log it with gravity"
        return Judgement(named_scale or 1.0, "", "physics", True, text=text, gravity_removed=True)
    if named_scale is not None:
        if _factor(size * named_scale) <= _FAR:
            return Judgement(named_scale, _acc_unit(named_scale), "name", True)
        text = f"acceleration: {seen}, no gravity in {_acc_unit(named_scale)} as named"
        if not fits:
            return Judgement(named_scale, _acc_unit(named_scale), "name", False, 0.0, text)
        return Judgement(units[nearest], nearest, "physics", True, text=f"{text}: taken as {nearest}")
    text = f"acceleration: no unit in its name, {seen}: taken as {nearest}"
    return Judgement(units[nearest], nearest, "physics" if fits else "assumed", fits, text=text)


def judge_pressure(values: FloatArray, named_scale: float | None = None) -> Judgement:
    """Unit of a barometer: near an atmosphere, and the same for a whole walk; ``scale`` is nan if it is none.

    Args:
        values: (N,) or (N, 1).
        named_scale: factor to hPa that its name tells.
    """
    low, high = np.percentile(values, (5, 95)) if values.size else (np.nan, np.nan)
    middle = float(np.median(values)) if values.size else float("nan")
    units = {"hPa": 1.0, "Pa": 0.01, "kPa": 10.0}

    def air(scale: float) -> bool:
        inside = _ATMOSPHERE_HPA[0] < middle * scale < _ATMOSPHERE_HPA[1]
        return bool(inside and (high - low) * scale < _SPREAD_HPA)

    if named_scale is not None and air(named_scale):
        unit = next((unit for unit, scale in units.items() if np.isclose(scale, named_scale)), "as named")
        return Judgement(named_scale, unit, "name", True)
    found = next((unit for unit, scale in units.items() if air(scale)), None)
    seen = f"{middle:.6g} in the middle"
    if found is None:
        return Judgement(float("nan"), "", "physics", True, text=f"pressure: {seen} is no air pressure: not used")
    why = "no unit in its name" if named_scale is None else "not in the unit of its name"
    sure = middle * units[found] > _HIGH_HPA
    return Judgement(units[found], found, "physics", sure, text=f"pressure: {why}, {seen}: taken as {found}")


def judge_gyroscope_unit(turning: Turning, acc: Stream, gyro: Stream, named_scale: float | None = None) -> Judgement:
    """Unit of a gyroscope: gravity and field turn as it says, and a walker turns neither like a top nor not at all.

    Args:
        turning: of both as ``gyro`` has them.
        acc: in m/s².
        gyro: (N, 3) as the file has it.
        named_scale: factor to rad/s that its name tells.
    """
    fast = float(np.percentile(np.linalg.norm(gyro.values, axis=1), 90)) if len(gyro) else 0.0
    norm = np.linalg.norm(acc.values, axis=1)
    moving = len(norm) > 1 and float(norm.std()) > _MOVING_M_S2
    least = _SLOWEST_RAD_S if moving else 0.0
    whole = _whole(gyro.values) and fast > 30.0
    units = _gyro_units(whole)
    possible = {unit: scale for unit, scale in units.items() if least <= fast * scale <= _FASTEST_RAD_S}
    seen = f"a tenth above {fast:.3g}"
    named = _gyro_unit(named_scale) if named_scale is not None else ""
    if named_scale is not None:
        allowed = least <= fast * named_scale <= _FASTEST_RAD_S
        if (not allowed and not possible) or not fast:
            return Judgement(
                named_scale, named, "name", False, 0.0, "" if allowed else f"turn rates: {seen}, unlikely in {named}"
            )
        if allowed:
            possible[named] = named_scale
    best, margin = _best_fit(turning, possible)
    if named in possible and best != named and margin < _AGAINST_NAME_SIGMAS:
        best, margin = named, 0.0
    if named_scale is not None and best == named:
        return Judgement(named_scale, named, "name", True, margin)
    if named_scale is not None:
        text = f"turn rates: {seen}, impossible in {named} as named: taken as {best}"
        return Judgement(possible[best], best, "physics", True, margin, text)
    text = f"turn rates: no unit in their names, {seen}"
    if best and margin >= _SURE_SIGMAS and (moving or np.isfinite(margin)):
        return Judgement(possible[best], best, "physics", True, margin, f"{text}: taken as {best}")
    if not (whole and best):  # of counts that which fits best, sure or not
        usual = ("rad/s", "°/s") if moving else ("°/s", "rad/s")
        best = next((unit for unit in usual if unit in possible), best or "°/s")
    return Judgement(units[best], best, "assumed", False, margin, f"{text}: {best} assumed")


def _best_fit(turning: Turning, possible: dict[str, float]) -> tuple[str, float]:
    """The unit in which gravity and field turn best as the gyroscope says, whatever its axes; sigmas over the next."""
    if len(possible) < 2:
        return next(iter(possible), ""), float("inf")
    fits = [(turning.gravity(scale), turning.field(scale)) for scale in possible.values()]
    costs = []
    for kind in zip(*fits, strict=True):
        known = [r for r in kind if r is not None]
        usual = min((r.usual for r in known), default=1.0)
        rows = [cost[cost.sum(axis=1).argmin()] for cost in (r.cost(usual) for r in known)]
        costs.append(np.array(rows) if rows else np.zeros((len(possible), 0)))
    order = np.argsort(sum(cost.sum(axis=1) for cost in costs))
    best, second = int(order[0]), int(order[1])
    both = tuple(costs)
    return list(possible)[best], gain(both, (second,) * len(both), (best,) * len(both))


def _blocks(acc: Stream) -> tuple[FloatArray, FloatArray, FloatArray]:
    """(B, 3) mean over each block, (B,) its norm, (B,) mean square of the samples."""
    if len(acc) < 2:
        return np.empty((0, 3)), np.empty(0), np.empty(0)
    block = np.floor((acc.t_s - acc.t_s[0]) / _BLOCK_S)
    first = np.flatnonzero(np.diff(block, prepend=-1.0))
    count = np.diff(np.append(first, len(acc)))
    means = np.add.reduceat(acc.values, first) / count[:, None]
    squares = np.add.reduceat((acc.values**2).sum(axis=1), first) / count
    whole = count >= 0.5 * np.median(count)
    return means[whole], np.linalg.norm(means[whole], axis=1), squares[whole]


def _factor(gravity_m_s2: float) -> float:
    """By how much it is off, as a factor above one."""
    ratio = max(gravity_m_s2, 1e-30) / STANDARD_GRAVITY_M_S2
    return max(ratio, 1.0 / ratio)


def _whole(values: FloatArray) -> bool:
    """Whether these are whole numbers, as counts are."""
    some = values[:2000]
    return bool((some == np.rint(some)).all())


def _acc_units(counts: bool) -> dict[str, float]:
    units = {"m/s²": 1.0, "g": STANDARD_GRAVITY_M_S2, "mg": STANDARD_GRAVITY_M_S2 / 1000.0}
    return units | ({f"raw, {n} a g": STANDARD_GRAVITY_M_S2 / n for n in _COUNTS_A_G} if counts else {})


def _gyro_units(counts: bool) -> dict[str, float]:
    units = {"rad/s": 1.0, "°/s": DEGREE_RAD, "m°/s": DEGREE_RAD / 1000.0}
    return units | ({f"raw, {n:g} a °/s": DEGREE_RAD / n for n in _COUNTS_A_DPS} if counts else {})


def _acc_unit(scale: float) -> str:
    return next((unit for unit, s in _acc_units(True).items() if np.isclose(s, scale, rtol=1e-3)), f"{scale:.4g} m/s²")


def _gyro_unit(scale: float) -> str:
    return next((u for u, s in _gyro_units(True).items() if np.isclose(s, scale, rtol=1e-3)), f"{scale:.4g} rad/s")
