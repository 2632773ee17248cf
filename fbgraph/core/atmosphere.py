"""The ICAO standard atmosphere, both ways: h = (T0 / L) (1 - (p / p0)^(R L / g)), ICAO Doc 7488."""

from __future__ import annotations

import numpy as np

from fbgraph.core.geometry import FloatArray

_TOP_M = 44330.77  # T0 / L
_SEA_LEVEL_HPA = 1013.25  # p0
_EXPONENT = 0.190263  # R L / g


def pressure_altitude_m(pressure_hpa: FloatArray | float) -> FloatArray:
    """Altitude at which the standard atmosphere has this pressure; only differences of it are used.

    Args:
        pressure_hpa: any shape, hPa.
    """
    return np.asarray(_TOP_M * (1.0 - (pressure_hpa / _SEA_LEVEL_HPA) ** _EXPONENT))


def altitude_pressure_hpa(altitude_m: FloatArray) -> FloatArray:
    """Pressure of the standard atmosphere at this altitude: ``pressure_altitude_m`` backwards; any shape."""
    return np.asarray(_SEA_LEVEL_HPA * (1.0 - altitude_m / _TOP_M) ** (1.0 / _EXPONENT))
