"""Where on Earth a local frame lies: latitude and longitude of its origin, x East and y North of it."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from fbgraph.core.errors import ConfigError
from fbgraph.core.geometry import FloatArray

_EARTH_M = 6_371_000.0


@dataclass(frozen=True)
class Georeference:
    """WGS 84 position of a local frame's origin; its y axis points to true North."""

    lat_deg: float
    lon_deg: float

    def geodetic_deg(self, xy_m: FloatArray) -> FloatArray:
        """(N, 2) latitudes and longitudes of (N, 2) places in the local frame."""
        import pymap3d

        lat_deg, lon_deg, _ = pymap3d.enu2geodetic(xy_m[:, 0], xy_m[:, 1], 0.0, self.lat_deg, self.lon_deg, 0.0)
        return np.column_stack((lat_deg, lon_deg))

    def local_m(self, lat_lon_deg: FloatArray) -> FloatArray:
        """(N, 2) places in the local frame of (N, 2) latitudes and longitudes."""
        import pymap3d

        lat_deg, lon_deg = lat_lon_deg.T
        east_m, north_m, _ = pymap3d.geodetic2enu(lat_deg, lon_deg, 0.0, self.lat_deg, self.lon_deg, 0.0)
        return np.column_stack((east_m, north_m))

    def apart_m(self, other: Georeference) -> float:
        """How far two origins are from each other, along the ground."""
        return float(along_ground_m(*np.array([[self.lat_deg, other.lat_deg], [self.lon_deg, other.lon_deg]]))[0])

    def moved(self, x_m: float, y_m: float) -> Georeference:
        """That of the frame whose origin lies there."""
        ((lat_deg, lon_deg),) = self.geodetic_deg(np.array([[x_m, y_m]])).tolist()
        return Georeference(lat_deg, lon_deg)


def along_ground_m(lat_deg: FloatArray, lon_deg: FloatArray) -> FloatArray:
    """(N - 1,) distances from each of N places to the next, on a sphere: right to half a per cent everywhere."""
    lat, lon = np.radians(lat_deg), np.radians(lon_deg)
    chord = np.sin(np.diff(lat) / 2) ** 2 + np.cos(lat[:-1]) * np.cos(lat[1:]) * np.sin(np.diff(lon) / 2) ** 2
    return np.asarray(2.0 * _EARTH_M * np.arcsin(np.sqrt(np.minimum(chord, 1.0))))


def parse_origin(text: str) -> Georeference:
    """Read ``LAT,LON`` in degrees.

    Raises:
        ConfigError: anything else.
    """
    try:
        lat_deg, lon_deg = (float(part) for part in text.split(","))
    except ValueError:
        lat_deg = lon_deg = math.nan
    if not (abs(lat_deg) <= 90.0 and abs(lon_deg) <= 180.0):
        raise ConfigError(f"--origin {text}: expected LAT,LON in degrees, for example --origin 49.4613,11.1110")
    return Georeference(lat_deg, lon_deg)
