"""Checkpoints: known places at known times. As truth they only score; as anchors they enter the graph.

They come from a log, or from a file of one of the forms that ``readers.places`` reads.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from fbgraph.core.errors import DataError
from fbgraph.core.geometry import BoolArray, FloatArray, IntArray
from fbgraph.core.georeference import Georeference, along_ground_m

_SLACK_S = 5.0
FASTEST_M_S, SLACK_M = 12.5, 1000.0  # nobody runs faster, and no survey is further off
_MOST_COORDINATE = 1e9
_MOST_ANCHORS = 20_000
IPIN_SIGMA_M = 0.5
"""Of a checkpoint of the IPIN competitions: surveyed to centimetres, pressed by hand some 0.4 s early or late."""
Clock = Literal["log", "own", "elapsed", "samples"]
"""What ``Checkpoints.t_s`` counts: seconds on the log's clock; seconds on a clock that may be the log's; seconds since
a recording began; rows of a log that has no clock."""


@dataclass(frozen=True)
class Checkpoints:
    """Places in a local frame (x East, y North, metres) and when the wearer was there.

    Attributes:
        t_s: (M,) non-decreasing; seconds on the clock of ``SensorLog.t0_s + t_s`` (the format's event clock).
        x_m, y_m: (M,).
        z_m: (M,) nan where unknown.
        floor: (M,) floor number as surveyed, nan where unknown; never metres.
        sigma_m: (M,) standard deviation of x and y, nan where not given.
        source: where they came from, for messages.
        georeference: where on Earth the local frame lies, None if nobody knows.
        doubt: why nobody can have been at all of them; empty if somebody can.
        gnss: whether a satellite receiver found them: then ``y_m`` is true North, and errors of neighbours are alike.
        clock: what ``t_s`` counts until ``place_clocks.on_logs_clock`` has brought it to the log's clock.
        elapsed_s: (M,) the same times in seconds since the recording began, where the file tells both.
        rate_hz: rows of the log a second, as a file that counts rows tells it; nan otherwise.
        notices: what was left out or assumed.
    """

    t_s: FloatArray
    x_m: FloatArray
    y_m: FloatArray
    z_m: FloatArray
    floor: FloatArray
    sigma_m: FloatArray
    source: str = ""
    georeference: Georeference | None = None
    doubt: str = ""
    gnss: bool = False
    clock: Clock = "log"
    elapsed_s: FloatArray | None = None
    rate_hz: float = np.nan
    notices: tuple[str, ...] = ()

    def __len__(self) -> int:
        return len(self.t_s)

    @property
    def label(self) -> str:
        """Where they came from, and how good they are if a receiver found them."""
        if not self.gnss:
            return self.source
        return f"{self.source} (GNSS, {float(np.median(self.sigma_m)):.1f} m 1σ on each axis)"

    @property
    def xy_m(self) -> FloatArray:
        """(M, 2)."""
        return np.column_stack((self.x_m, self.y_m))

    @property
    def first(self) -> Georeference | None:
        """Where on Earth the first of them is, if that is known."""
        if self.georeference is None or len(self) == 0:
            return None
        return self.georeference.moved(float(self.x_m[0]), float(self.y_m[0]))

    def require_within(self, start_s: float, end_s: float) -> None:
        """Refuse places of another log or clock.

        Args:
            start_s, end_s: of the log, on the clock of ``t_s``; a few seconds more are allowed.

        Raises:
            DataError: one of them lies outside.
        """
        outside = np.flatnonzero((self.t_s < start_s - _SLACK_S) | (self.t_s > end_s + _SLACK_S))
        if len(outside):
            raise DataError(
                f"{self.source}: the anchor at {self.t_s[outside[0]]:.1f} s lies outside the log "
                f"({start_s:.1f} to {end_s:.1f} s): another log's, or another clock"
            )

    def require_possible(self) -> None:
        """Refuse anchors where nobody can have been, or more of them than a walk has.

        Raises:
            DataError: naming the rows.
        """
        if self.doubt:
            raise DataError(f"{self.source}: {self.doubt}")
        if len(self) > _MOST_ANCHORS:
            raise DataError(f"{self.source}: {len(self)} anchors, the limit is {_MOST_ANCHORS}; name fewer")

    def since(self, t0_s: float) -> Checkpoints:
        """The same places, their times in seconds since ``t0_s``."""
        return replace(self, t_s=self.t_s - t0_s)

    def in_frame_of(self, other: Checkpoints | None) -> Checkpoints:
        """The same places in another's frame, where both are known on Earth; else as they are."""
        if other is None or self.georeference is None or other.georeference is None:
            return self
        origin = np.array([[self.georeference.lat_deg, self.georeference.lon_deg]])
        dx_m, dy_m = other.georeference.local_m(origin)[0]
        return replace(self, x_m=self.x_m + dx_m, y_m=self.y_m + dy_m, georeference=other.georeference)

    def exchanged(self) -> Checkpoints | None:
        """The same places had latitude and longitude been exchanged; None where that cannot be."""
        if self.georeference is None or len(self) == 0:
            return None
        lat_deg, lon_deg = self.georeference.geodetic_deg(self.xy_m).T
        if np.abs(lon_deg).max() > 90.0:
            return None
        first = Georeference(float(lon_deg[0]), float(lat_deg[0]))
        x_m, y_m = first.local_m(np.column_stack((lon_deg, lat_deg))).T
        return replace(self, x_m=x_m, y_m=y_m, georeference=first)

    def select(self, which: slice | IntArray | BoolArray) -> Checkpoints:
        """The checkpoints at these indices."""
        fields = ("t_s", "x_m", "y_m", "z_m", "floor", "sigma_m")
        elapsed_s = None if self.elapsed_s is None else self.elapsed_s[which]
        return replace(self, elapsed_s=elapsed_s, **{name: getattr(self, name)[which] for name in fields})


def checkpoints(
    t_s: FloatArray,
    x_m: FloatArray,
    y_m: FloatArray,
    z_m: FloatArray | None = None,
    floor: FloatArray | None = None,
    sigma_m: FloatArray | None = None,
    source: str = "",
    georeference: Georeference | None = None,
    lat_lon_deg: FloatArray | None = None,
) -> Checkpoints:
    """Checkpoints in order of time, with nan for what is not known.

    Args:
        t_s, x_m, y_m, z_m, floor, sigma_m, source, georeference: as in ``Checkpoints``.
        lat_lon_deg: (M, 2) the same places on Earth, where they were told so.
    """
    order = np.argsort(t_s, kind="stable")

    def column(values: FloatArray | None) -> FloatArray:
        full = np.full(len(t_s), np.nan) if values is None else np.asarray(values, dtype=float)
        return full[order]

    return Checkpoints(
        t_s=column(t_s),
        x_m=column(x_m),
        y_m=column(y_m),
        z_m=column(z_m),
        floor=column(floor),
        sigma_m=column(sigma_m),
        source=source,
        georeference=georeference,
        doubt=_impossible(order, column(t_s), np.column_stack((x_m, y_m))[order], column(sigma_m), lat_lon_deg),
    )


def _impossible(
    order: IntArray, t_s: FloatArray, xy_m: FloatArray, sigma_m: FloatArray, lat_lon_deg: FloatArray | None
) -> str:
    """The two places between which nobody can have gone in the time, by their rows in the file; else empty."""
    if len(t_s) < 2:
        return ""
    places, digits, unit = xy_m, 2, " m"
    with np.errstate(over="ignore", invalid="ignore"):
        apart_m = np.hypot(*np.diff(xy_m, axis=0).T)
        if lat_lon_deg is not None:
            places, digits, unit = lat_lon_deg[order], 6, "°"
            apart_m = along_ground_m(*places.T)
        unsure_m = 3.0 * np.nan_to_num(sigma_m, nan=0.0)
        most_m = SLACK_M + FASTEST_M_S * np.diff(t_s) + unsure_m[:-1] + unsure_m[1:]
        far = np.flatnonzero(~(apart_m <= most_m))
    if len(far) == 0:
        return ""
    k = int(far[0])
    seconds = float(t_s[k + 1] - t_s[k])
    first, second = (f"{', '.join(_shown(number, digits) for number in places[i].tolist())}{unit}" for i in (k, k + 1))
    far_m = float(apart_m[k])  # one of numpy's would warn where it is divided beyond any number
    speed = f", which is {far_m / seconds:.3g} m/s" if seconds > 0.0 else ""
    return (
        f"from row {order[k] + 1} ({first}) to row {order[k + 1] + 1} ({second}) it is {far_m / 1e3:.4g} km "
        f"in {seconds:.4g} s{speed}: nobody can; check both rows' places and times"
    )


def _shown(number: float, digits: int) -> str:
    """A coordinate; one with hundreds of digits is none."""
    return f"{number:.{digits}f}" if abs(number) < _MOST_COORDINATE else f"{number:.4g}"


def anchor_breadcrumbs(anchors: Checkpoints, t_s: FloatArray) -> IntArray:
    """(M,) indices of the breadcrumbs nearest in time to M anchors.

    Args:
        anchors: on the clock of ``t_s``.
        t_s: (K+1,) times of the breadcrumbs.
    """
    after = np.minimum(np.searchsorted(t_s, anchors.t_s), len(t_s) - 1)
    before = np.maximum(after - 1, 0)
    nearest = np.where(np.abs(t_s[before] - anchors.t_s) <= np.abs(t_s[after] - anchors.t_s), before, after)
    return np.asarray(np.searchsorted(t_s, t_s[nearest]))  # the first of equal times
