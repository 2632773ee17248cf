"""CSV: the breadcrumbs with their covariance, as ``breadcrumbs.csv`` of a run, of any estimator."""

from __future__ import annotations

from typing import BinaryIO

from fbgraph.exports.exported_walk import ExportedWalk
from fbgraph.run.folder import write_breadcrumbs

DESCRIPTION = "a row a breadcrumb with standard deviations and covariance, nan where unknown"
SUFFIX, BINARY, ON_EARTH = ".csv", False, False


def write(walk: ExportedWalk, out: BinaryIO) -> list[str]:
    """Write it."""
    write_breadcrumbs(out, walk.trajectory, 0.0)
    return []
