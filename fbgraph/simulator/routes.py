"""Routes for the simulator: waypoints, pauses, and the line a walker takes through them."""

from __future__ import annotations

from dataclasses import dataclass
from io import BytesIO
from pathlib import Path

import numpy as np

from fbgraph.core.bounded import MOST_PLACES, table_of_places
from fbgraph.core.errors import ConfigError, DataError
from fbgraph.core.geometry import FloatArray, wrap_angle

_STOP_TURN_RAD = 2.3  # who turns back further than this stops and turns on the spot
_MAX_GRADE = 1.5
_Rows = tuple[tuple[float, ...], ...]


@dataclass(frozen=True)
class Route:
    """Where to walk.

    Attributes:
        name: for messages and log names; the path of a route file.
        waypoints_m: (M, 3) x East, y North, z up, M >= 2; the walk starts at the first.
        pause_s: (M,) how long to stand still there.
        labels: M names of the waypoints, for checkpoints.

    Raises:
        DataError: fewer than two waypoints, values that are not finite, negative pauses, two waypoints at the same
            place in a row, or a leg too steep to walk.
    """

    name: str
    waypoints_m: FloatArray
    pause_s: FloatArray
    labels: tuple[str, ...]

    def __post_init__(self) -> None:
        if len(self.waypoints_m) < 2:
            raise DataError(f"{self.name}: a route needs at least two waypoints, this has {len(self.waypoints_m)}")
        if not (np.isfinite(self.waypoints_m).all() and np.isfinite(self.pause_s).all()):
            row = int(np.argmin(np.isfinite(self.waypoints_m).all(axis=1) & np.isfinite(self.pause_s)))
            raise DataError(f"{self.name}: waypoint {row + 1} is not all numbers")
        if (self.pause_s < 0).any():
            raise DataError(f"{self.name}: waypoint {int(np.argmax(self.pause_s < 0)) + 1} has a negative pause_s")
        legs = np.diff(self.waypoints_m, axis=0)
        level = np.hypot(legs[:, 0], legs[:, 1])
        if (level < 0.05).any():
            row = int(np.argmin(level))
            raise DataError(f"{self.name}: waypoints {row + 1} and {row + 2} are less than 5 cm apart on the plan")
        if (np.abs(legs[:, 2]) > _MAX_GRADE * level).any():
            row = int(np.argmax(np.abs(legs[:, 2]) / level))
            raise DataError(f"{self.name}: from waypoint {row + 1} to {row + 2} is too steep to walk")

    @property
    def length_m(self) -> float:
        """Along the straight legs, on the plan."""
        return float(np.hypot(*np.diff(self.waypoints_m[:, :2], axis=0).T).sum())

    @property
    def closed(self) -> bool:
        """Whether it ends where it begins."""
        return bool(np.allclose(self.waypoints_m[0], self.waypoints_m[-1]))

    def repeated(self, laps: int) -> Route:
        """The route so many times over: round and round if it is closed, to and fro if not.

        Raises:
            ConfigError: fewer than one lap, or more than anybody walks.
        """
        if laps < 1:
            raise ConfigError(f"laps must be at least 1, not {laps}")
        if laps * len(self.waypoints_m) > MOST_PLACES:
            raise ConfigError(f"{laps} laps of {len(self.waypoints_m)} waypoints, the limit is {MOST_PLACES} in all")
        there = list(range(len(self.waypoints_m)))
        back = there if self.closed else there[::-1]
        order = there + [k for lap in range(1, laps) for k in (back if lap % 2 else there)[1:]]
        labels = tuple(self.labels[k] for k in order)
        return Route(self.name, self.waypoints_m[order], self.pause_s[order], labels)

    def stops(self) -> list[int]:
        """Indices of the waypoints where the walker comes to a stand: first, last, pauses and about-turns."""
        heading = np.arctan2(*np.diff(self.waypoints_m[:, :2], axis=0).T[::-1])
        stand = self.pause_s > 0
        stand[1:-1] |= np.abs(wrap_angle(np.diff(heading))) > _STOP_TURN_RAD
        stand[[0, -1]] = True
        return np.flatnonzero(stand).tolist()


def _and_back(rows: _Rows) -> _Rows:
    return rows + rows[-2::-1]


_NAMED: dict[str, _Rows] = {  # x_m, y_m, z_m, pause_s
    # The ForestBack paper says what this looks like, not where the checkpoints are: A to E around a central obstacle,
    # diagonal, horizontal and vertical legs, along the right side of the obstacle after C; 11.8 s a trial.
    "obstacle": ((0, 0), (2.5, 2.5), (6.5, 2.5), (6.5, -1.5), (8.9, -1.5)),
    "square": ((0, 0), (10, 0), (10, 10), (0, 10), (0, 0)),
    "straight": ((0, 0), (50, 0)),
    "eight": ((0, 0), (4, 4), (9, 4), (9, -4), (4, -4), (0, 0), (-4, 4), (-9, 4), (-9, -4), (-4, -4), (0, 0)),
    "out-and-back": _and_back(((0, 0), (12, 0), (12, 8), (22, 8), (22, 2), (32, 2, 0, 30))),
    "stairs": _and_back(((0, 0), (8, 0), (8, 2), (8, 7.4, -3), (8, 12, -3), (16, 12, -3, 10))),
}
ROUTE_NAMES = tuple(_NAMED)
"""What ``load_route`` takes besides a path."""


def load_route(source: str, scale: float = 1.0, laps: int = 1) -> Route:
    """A route by name, or from a CSV file of waypoints ``x_m,y_m[,z_m][,pause_s]`` with a header.

    Args:
        source: one of ``ROUTE_NAMES`` or a path.
        scale: stretches the plan (not the heights).
        laps: how often to walk it, see ``Route.repeated``.

    Returns:
        The route, moved so that it starts at the origin.

    Raises:
        ConfigError: neither a name nor a file; a scale or number of laps that cannot be.
        DataError: a file that is no route.
    """
    if not 0 < scale < np.inf:
        raise ConfigError(f"the scale of a route must be a positive number, not {scale}")
    if source in _NAMED:
        rows = np.array([row + (0.0,) * (4 - len(row)) for row in _NAMED[source]], dtype=float)
    elif Path(source).exists():
        rows = _read_rows(Path(source))
    else:
        raise ConfigError(f"route {source!r}: neither {', '.join(ROUTE_NAMES)} nor a file")
    rows[:, :3] -= rows[0, :3]
    rows[:, :2] *= scale
    letters = source == "obstacle"
    labels = tuple(chr(ord("A") + k) if letters else str(k + 1) for k in range(len(rows)))
    return Route(source, rows[:, :3], rows[:, 3], labels).repeated(laps)


def _read_rows(path: Path) -> FloatArray:
    """(M, 4) x, y, z, pause as the file has them, M >= 1."""
    import pandas as pd  # here, because it takes a second to import

    data = table_of_places(path, "route CSV")
    try:
        table = pd.read_csv(BytesIO(data), comment="#", skipinitialspace=True)
    except ValueError as error:  # pandas' parser and decoding errors are ValueErrors
        raise DataError(f"{path}: not a readable route CSV: {str(error).splitlines()[0]}") from error
    table = table.rename(columns=lambda name: str(name).strip())
    known = ("x_m", "y_m", "z_m", "pause_s")
    missing = [name for name in known[:2] if name not in table]
    unknown = [str(name) for name in table.columns if name not in known]
    if missing or unknown:
        wrong = f"no column {', '.join(missing)}" if missing else f"unknown column {', '.join(unknown)}"
        raise DataError(f"{path}: {wrong}; a route file has x_m,y_m[,z_m][,pause_s]")
    if len(table) == 0:
        raise DataError(f"{path}: a header and no waypoint")
    rows = np.zeros((len(table), 4))
    for column, name in enumerate(known):
        if name in table:
            rows[:, column] = pd.to_numeric(table[name], errors="coerce").to_numpy(dtype=float)
    if not np.isfinite(rows).all():
        row, column = np.argwhere(~np.isfinite(rows))[0].tolist()
        raise DataError(f"{path}: row {row + 1} after the header: {known[column]} is not a number")
    return rows


@dataclass(frozen=True)
class SmoothPath:
    """Straight lines joined by arcs; curvature is constant along each piece, so yaw is linear in distance.

    Attributes:
        s_m: (P + 1,) distance along the path at the joints of its P pieces, non-decreasing.
        x_m, y_m, yaw_rad: (P + 1,) there; yaw unwrapped.
        waypoint_s_m: (M,) where along the path its waypoints are (the middle of the arc at a corner).
        waypoint_z_m: (M,) height there; linear between.
    """

    s_m: FloatArray
    x_m: FloatArray
    y_m: FloatArray
    yaw_rad: FloatArray
    waypoint_s_m: FloatArray
    waypoint_z_m: FloatArray

    def at(self, s_m: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
        """x, y, z and yaw at these distances."""
        piece = np.clip(np.searchsorted(self.s_m, s_m, side="right") - 1, 0, len(self.s_m) - 2)
        yaw = self.yaw(s_m)
        half = (yaw - self.yaw_rad[piece]) / 2.0
        chord = (s_m - self.s_m[piece]) * np.sinc(half / np.pi)
        direction = self.yaw_rad[piece] + half
        x, y = self.x_m[piece] + chord * np.cos(direction), self.y_m[piece] + chord * np.sin(direction)
        return x, y, self.z(s_m), yaw

    def yaw(self, s_m: FloatArray | float) -> FloatArray:
        """Direction of the path, unwrapped."""
        return np.asarray(np.interp(s_m, self.s_m, self.yaw_rad))

    def z(self, s_m: FloatArray | float) -> FloatArray:
        """Height of the path."""
        return np.asarray(np.interp(s_m, self.waypoint_s_m, self.waypoint_z_m))


def round_corners(waypoints_m: FloatArray, turn_length_m: float, yaw_rad: float) -> SmoothPath:
    """The line through waypoints with every corner rounded to an arc.

    Args:
        waypoints_m: (M, 3).
        turn_length_m: length of the arc, whatever its angle; less where a leg is too short for it.
        yaw_rad: the path's first yaw is the one nearest to this.
    """
    legs = np.diff(waypoints_m[:, :2], axis=0)
    leg_m, heading = np.hypot(*legs.T), np.arctan2(legs[:, 1], legs[:, 0])
    turn = wrap_angle(np.diff(heading))
    bent = np.abs(turn) > 1e-6
    half_tan = np.tan(np.abs(np.where(bent, turn, 1.0)) / 2.0)
    wanted = turn_length_m / np.abs(np.where(bent, turn, 1.0)) * half_tan
    cut = np.where(bent, np.minimum(wanted, 0.45 * np.minimum(leg_m[:-1], leg_m[1:])), 0.0)
    pieces_m, bends = np.empty(2 * len(leg_m) - 1), np.zeros(2 * len(leg_m) - 1)
    pieces_m[0::2] = leg_m - np.append(cut, 0.0) - np.insert(cut, 0, 0.0)
    pieces_m[1::2] = cut / half_tan * np.abs(turn)
    bends[1::2] = np.where(bent, turn, 0.0)
    s_m = np.append(0.0, np.cumsum(pieces_m))
    first = yaw_rad + float(wrap_angle(heading[:1] - yaw_rad)[0])
    yaw = first + np.append(0.0, np.cumsum(bends))
    chord, direction = pieces_m * np.sinc(bends / 2.0 / np.pi), yaw[:-1] + bends / 2.0
    middles = (s_m[1:-1:2] + s_m[2::2]) / 2.0
    return SmoothPath(
        s_m=s_m,
        x_m=waypoints_m[0, 0] + np.append(0.0, np.cumsum(chord * np.cos(direction))),
        y_m=waypoints_m[0, 1] + np.append(0.0, np.cumsum(chord * np.sin(direction))),
        yaw_rad=yaw,
        waypoint_s_m=np.concatenate(([0.0], middles, s_m[-1:])),
        waypoint_z_m=waypoints_m[:, 2],
    )
