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
        self._t_s = np.empty(0)
        self._field_ut = np.empty((0, 3))
        self._yaw_rad = np.empty(0)
        self._changes_ut = np.empty(0)  # from each sample to the next
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
        known = len(self._t_s)
        self._t_s = np.concatenate((self._t_s, t_s))
        self._field_ut = np.concatenate((self._field_ut, field_ut))
        new = np.linalg.norm(self._field_ut[max(known, 1) :] - self._field_ut[max(known, 1) - 1 : -1], axis=1)
        self._changes_ut = changes = np.concatenate((self._changes_ut, new))
        self._yaw_rad = np.concatenate((self._yaw_rad, yaw_rad))
        jumps: list[tuple[float, float, float]] = []
        for at in np.flatnonzero((changes > _LEAST_UT) & (self._t_s[:-1] > self._judged_s)):
            end = int(np.searchsorted(self._t_s, self._t_s[at + 1] + _SIDE_S))
            if end >= len(self._t_s):
                break  # what follows has not come yet
            self._judged_s = float(self._t_s[at])
            if (jump := self._jump(int(at), end, changes)) is not None:
                jumps.append((float(self._t_s[end]), float(jump[0]), float(jump[1])))
        start = int(np.searchsorted(self._t_s, self._t_s[-1] - 3.0 * _SIDE_S))
        self._changes_ut = self._changes_ut[start:]
        self._t_s, self._field_ut, self._yaw_rad = self._t_s[start:], self._field_ut[start:], self._yaw_rad[start:]
        return np.array(jumps).reshape(-1, 3)

    def _jump(self, at: int, end: int, changes: FloatArray) -> FloatArray | None:
        """By how much the field jumped after sample ``at``, if it was steady before and stays so until ``end``."""
        begin = int(np.searchsorted(self._t_s, self._t_s[at] - _SIDE_S))
        before, after = self._field_ut[begin : at + 1], self._field_ut[at + 1 : end]
        if min(len(before), len(after)) < _LEAST_SAMPLES:
            return None
        jump = self._field_ut[at + 1] - self._field_ut[at]
        size = float(np.linalg.norm(jump))
        usual = float(np.median(np.concatenate((changes[begin:at], changes[at + 1 : end - 1]))))
        middle = np.median(before, axis=0)
        # what is in the device turns with it
        added = _turned_back(after - middle, self._yaw_rad[at + 1 : end] - self._yaw_rad[at + 1])
        stays = np.median(added, axis=0)
        scatter = max(_scatter(before, middle), _scatter(added, stays))
        same = float(np.linalg.norm(stays - jump)) < _STAYS * size
        if not same or scatter > _STEADY * size or size < _TIMES_USUAL * usual:
            return None
        return np.asarray(_turned_back(jump[None], self._yaw_rad[at + 1 : at + 2])[0])


def _turned_back(vectors: FloatArray, angle_rad: FloatArray) -> FloatArray:
    cos, sin = np.cos(angle_rad), np.sin(angle_rad)
    x, y = vectors[:, 0], vectors[:, 1]
    return np.column_stack((cos * x + sin * y, cos * y - sin * x, vectors[:, 2]))


def _scatter(vectors: FloatArray, middle: FloatArray) -> float:
    return float(np.median(np.linalg.norm(vectors - middle, axis=1)))
