"""When the magnetometer's zero jumped: the device calibrated it anew, or a magnet came to stay.

Iron that the wearer passes changes the field within metres, hence over many samples, and is left behind again. What
changes between two samples and stays was in the device.
"""

from __future__ import annotations

import numpy as np

from fbgraph.core.geometry import FloatArray

_SIDE_S = 0.6  # how long the field must have been steady before, and stay so after
_LEAST_SAMPLES = 4  # on either side
_LEAST_UT = 5.0
_TIMES_USUAL = 6.0  # what usually changes between two samples
_STAYS, _STEADY = 0.35, 0.25  # of the jump


class FieldJumps:
    """Magnetometer samples in a frame that does not turn with the device in; jumps out, half a second later."""

    def __init__(self) -> None:
        self._rows = np.empty((0, 6))  # time, field, yaw, change of the field since the sample before
        self._judged_s = -np.inf

    def push(self, t_s: FloatArray, field_ut: FloatArray, yaw_rad: FloatArray) -> FloatArray:
        """Take the next samples; return the jumps that became certain, (J, 3): when, and by how much.

        The jump is horizontal, ahead and to the left of the device as ``yaw_rad`` has it, µT.

        Args:
            t_s: (N,) times.
            field_ut: (N, 3) field in a level frame that does not turn; finite.
            yaw_rad: (N,) how far the device has turned about the vertical, unwrapped.
        """
        if len(t_s) == 0:
            return np.empty((0, 3))
        known = len(self._rows)
        rows = np.empty((known + len(t_s), 6))
        rows[:known], rows[known:, 0], rows[known:, 1:4], rows[known:, 4] = self._rows, t_s, field_ut, yaw_rad
        if known == 0:
            rows[0, 5], known = 0.0, 1
        step = rows[known:, 1:4] - rows[known - 1 : -1, 1:4]
        rows[known:, 5] = np.sqrt((step * step).sum(axis=1))
        at_s, large = rows[:, 0], rows[:, 5] > _LEAST_UT
        jumps: list[tuple[float, float, float]] = []
        for after in np.flatnonzero(large).tolist() if large.any() else ():
            if at_s[after - 1] <= self._judged_s:
                continue
            end = int(at_s.searchsorted(at_s[after] + _SIDE_S))
            if end >= len(rows):
                break  # what follows has not come yet
            self._judged_s = float(at_s[after - 1])
            if (jump := _jump(rows, after, end)) is not None:
                jumps.append((float(at_s[end]), float(jump[0]), float(jump[1])))
        self._rows = rows[int(at_s.searchsorted(at_s[-1] - 3.0 * _SIDE_S)) :]
        return np.array(jumps).reshape(-1, 3)


def _jump(rows: FloatArray, first: int, end: int) -> FloatArray | None:
    """By how much the field jumped before sample ``first``, if it was steady till then and stays so until ``end``."""
    begin = int(rows[:, 0].searchsorted(rows[first - 1, 0] - _SIDE_S))
    before, after = rows[begin:first, 1:4], rows[first:end, 1:4]
    if min(len(before), len(after)) < _LEAST_SAMPLES:
        return None
    jump = rows[first, 1:4] - rows[first - 1, 1:4]
    size = float(np.linalg.norm(jump))
    usual = float(np.median(np.concatenate((rows[begin + 1 : first, 5], rows[first + 1 : end, 5]))))
    middle = np.median(before, axis=0)
    # what is in the device turns with it
    added = _turned_back(after - middle, rows[first:end, 4] - rows[first, 4])
    stays = np.median(added, axis=0)
    scatter = max(_scatter(before, middle), _scatter(added, stays))
    same = float(np.linalg.norm(stays - jump)) < _STAYS * size
    if not same or scatter > _STEADY * size or size < _TIMES_USUAL * usual:
        return None
    return np.asarray(_turned_back(jump[None], rows[first : first + 1, 4])[0])


def _turned_back(vectors: FloatArray, angle_rad: FloatArray) -> FloatArray:
    cos, sin = np.cos(angle_rad), np.sin(angle_rad)
    x, y = vectors[:, 0], vectors[:, 1]
    return np.column_stack((cos * x + sin * y, cos * y - sin * x, vectors[:, 2]))


def _scatter(vectors: FloatArray, middle: FloatArray) -> float:
    return float(np.median(np.linalg.norm(vectors - middle, axis=1)))
