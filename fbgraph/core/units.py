"""Factors from the units of sensors' data sheets to SI."""

from __future__ import annotations

import math

STANDARD_GRAVITY_M_S2 = 9.80665
"""One g (CODATA)."""
DEGREE_RAD = math.pi / 180.0
"""One degree."""
