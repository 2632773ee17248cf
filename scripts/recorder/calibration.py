"""What a recorder finds out about its sensors before a walk. Runs on MicroPython and CPython."""

import json
from math import sqrt

REST_S = 2.0
_STILL_DPS, _STILL_G = 1.0, 0.03  # rms about the mean
_MOST_BIAS_DPS = 15.0
_FIELD_UT = (15.0, 100.0)
_ROUND = 0.5  # of the sphere's diameter that each axis must have seen
_LEAST = 60
_SCALE_UT = 50.0


class Rest:
    """Gyroscope's zero from two seconds at rest.

    Attributes:
        bias_dps: what it reads at rest; None until that is known.
    """

    def __init__(self) -> None:
        self.bias_dps: tuple[float, float, float] | None = None
        self._begin()

    def _begin(self) -> None:
        self._count = 0
        self._sum = [0.0] * 6
        self._square = [0.0] * 6
        self._first: list[float] = []

    def take(self, acc_g: tuple[float, float, float], gyro_dps: tuple[float, float, float]) -> bool:
        """Take a sample; whether the zero is known. Movement begins it anew."""
        values = list(acc_g + gyro_dps)
        if not self._count:
            self._first = values
        for i in range(6):
            off = values[i] - self._first[i]
            self._sum[i] += off
            self._square[i] += off * off
        self._count += 1
        if self._count % 20 == 0 and not self._still():
            self._begin()
        if self._count < REST_S * 100:
            return False
        mean = [self._first[i] + self._sum[i] / self._count for i in range(6)]
        self._begin()
        if max(abs(one) for one in mean[3:]) > _MOST_BIAS_DPS:
            return False
        self.bias_dps = mean[3], mean[4], mean[5]
        return True

    def _still(self) -> bool:
        count = self._count
        for i in range(6):
            variance = self._square[i] / count - (self._sum[i] / count) ** 2
            if variance > (_STILL_G if i < 3 else _STILL_DPS) ** 2:
                return False
        return True


class Sphere:
    """The magnetometer's offsets from a figure of eight: the sphere that fits its readings (least squares)."""

    def __init__(self) -> None:
        self.count = 0
        self._first = (0.0, 0.0, 0.0)
        self._normal = [[0.0] * 5 for _ in range(4)]
        self._low = [1e9] * 3
        self._high = [-1e9] * 3

    def take(self, field_ut: tuple[float, float, float]) -> None:
        """Take a reading."""
        if not self.count:
            self._first = field_ut
        self.count += 1
        p = [(field_ut[i] - self._first[i]) / _SCALE_UT for i in range(3)]
        row = [2.0 * p[0], 2.0 * p[1], 2.0 * p[2], 1.0, p[0] * p[0] + p[1] * p[1] + p[2] * p[2]]
        for i in range(4):
            for j in range(5):
                self._normal[i][j] += row[i] * row[j]
        for i in range(3):
            self._low[i] = min(self._low[i], field_ut[i])
            self._high[i] = max(self._high[i], field_ut[i])

    def fit(self) -> tuple[tuple[float, float, float], float] | None:
        """Offsets and radius, µT; None while the readings do not go round enough of a sphere."""
        if self.count < _LEAST:
            return None
        solved = _solved([row[:] for row in self._normal])
        if solved is None:
            return None
        radius = sqrt(max(solved[3] + solved[0] ** 2 + solved[1] ** 2 + solved[2] ** 2, 0.0)) * _SCALE_UT
        if not _FIELD_UT[0] <= radius <= _FIELD_UT[1]:
            return None
        if min(self._high[i] - self._low[i] for i in range(3)) < _ROUND * 2.0 * radius:
            return None
        x, y, z = (self._first[i] + solved[i] * _SCALE_UT for i in range(3))
        return (x, y, z), radius


def _solved(rows: list[list[float]]) -> list[float] | None:
    """Gauss's elimination of four equations; None if they say too little."""
    for i in range(4):
        best = max(range(i, 4), key=lambda k: abs(rows[k][i]))
        rows[i], rows[best] = rows[best], rows[i]
        if abs(rows[i][i]) < 1e-4:
            return None
        for k in range(4):
            if k != i:
                factor = rows[k][i] / rows[i][i]
                for j in range(i, 5):
                    rows[k][j] -= factor * rows[i][j]
    return [rows[i][4] / rows[i][i] for i in range(4)]


def stored_offsets(path: str) -> tuple[float, float, float] | None:
    """The magnetometer's offsets as an earlier walk found them; None if none did."""
    try:
        with open(path) as file:
            x, y, z = json.load(file)["mag_ut"]
        return float(x), float(y), float(z)
    except (OSError, ValueError, KeyError, TypeError):
        return None


def store_offsets(path: str, offsets_ut: tuple[float, float, float]) -> None:
    """Keep the magnetometer's offsets for later walks."""
    with open(path, "w") as file:
        json.dump({"mag_ut": list(offsets_ut)}, file)
