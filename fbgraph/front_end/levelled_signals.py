"""LevelledSignals: what the leveller delivers and the step detector looks at."""

from __future__ import annotations

from dataclasses import dataclass, fields
from typing import Any

import numpy as np
from numpy.typing import NDArray

from fbgraph.core.geometry import BoolArray, FloatArray, IntArray


@dataclass(frozen=True)
class LevelledSignals:
    """Signals of a piece of walk on a uniform grid (silent where the inertial sensors were).

    Attributes:
        index: (N,) grid index; ``t_s = index / rate_hz``. Consecutive except across gaps.
        acc_norm_m_s2: (N,) magnitude of specific force.
        acc_n_m_s2: (N, 3) specific force in the levelled frame turned to face the walking direction: forward, left, up.
        mount_up_rad: (N,) elevation of ``device.mount`` above the horizon.
        tilt_rate_rad_s: (N,) magnitude of the angular rate about horizontal axes: shaking, not turning.
        yaw_gyro_rad: (N,) walking direction by the gyroscope alone, unwrapped, arbitrary start; its bias still in it.
        yaw_mag_rad: (N,) walking direction by the compass, wrapped, nan where there is no magnetometer sample.
        mag_norm_ut: (N,) strength of the field, nan where unknown.
        mag_dip_rad: (N,) angle of the field below the horizon, nan where unknown.
        altitude_m: (N,) by the standard atmosphere; nan before the first barometer sample.
        field_jump_ut: (N, 2) by how much the magnetometer's zero has jumped, where that became certain: horizontal,
            turned by minus the direction of North, as ``estimators.compass`` has the field; zeros elsewhere.
        still: (N,) whether the device has been standing still for the whole still window.
    """

    index: IntArray
    t_s: FloatArray
    acc_norm_m_s2: FloatArray
    acc_n_m_s2: FloatArray
    mount_up_rad: FloatArray
    tilt_rate_rad_s: FloatArray
    yaw_gyro_rad: FloatArray
    yaw_mag_rad: FloatArray
    mag_norm_ut: FloatArray
    mag_dip_rad: FloatArray
    altitude_m: FloatArray
    field_jump_ut: FloatArray
    still: BoolArray

    def __len__(self) -> int:
        return len(self.index)

    @property
    def arrays(self) -> list[NDArray[Any]]:
        """All of them, in the order in which they make signals."""
        return [getattr(self, name) for name in _SIGNALS]

    def head(self, count: int) -> LevelledSignals:
        """The first ``count`` samples."""
        return LevelledSignals(*[getattr(self, name)[:count] for name in _SIGNALS])

    def tail(self, count: int) -> LevelledSignals:
        """The last ``count`` samples."""
        start = max(len(self) - count, 0)
        return LevelledSignals(*[getattr(self, name)[start:] for name in _SIGNALS])

    def between(self, start_s: float, end_s: float) -> LevelledSignals:
        """The samples with start_s <= t < end_s."""
        lo, hi = np.searchsorted(self.t_s, (start_s, end_s))
        return LevelledSignals(*[getattr(self, name)[lo:hi] for name in _SIGNALS])

    @staticmethod
    def concatenate(pieces: list[LevelledSignals]) -> LevelledSignals:
        """Pieces in order as one."""
        if len(pieces) == 1:
            return pieces[0]
        return LevelledSignals(*[np.concatenate([getattr(p, name) for p in pieces]) for name in _SIGNALS])


def gaps(index: IntArray) -> list[int]:
    """Where a grid index goes on after a gap: positions in ``index``, which increases."""
    if len(index) == 0 or int(index[-1]) - int(index[0]) == len(index) - 1:
        return []
    whole: list[int] = (np.flatnonzero(index[1:] - index[:-1] > 1) + 1).tolist()
    return whole


_SIGNALS = tuple(f.name for f in fields(LevelledSignals))
