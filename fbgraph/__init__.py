"""fbgraph: where somebody walked, from the sensors alone.

ForestBack's breadcrumb dead reckoning rebuilt as a factor graph on GTSAM.

    >>> import fbgraph
    >>> walk = fbgraph.smooth("walk.csv", truth="truth.csv")
    >>> walk.trajectories["smoothed"].to_dataframe()

Conventions, stated once and kept everywhere
--------------------------------------------
Units
    SI inside: seconds, metres, radians, m/s², rad/s, µT, hPa. Degrees appear only on the command line, in
    configuration keys ending in ``_deg`` and in plots. Units are part of names: ``dt_s``, ``length_m``, ``yaw_rad``.
Time
    ``t_ns`` (int64, the log's own clock) inside the readers; everywhere else ``t_s``, float seconds since the log's
    first inertial sample. ``SensorLog.t0_s`` brings ``t_s`` back to the clock on which the format stamps its events
    and truth: ``t_s + t0_s``.
World frame ``n``
    x East, y North, z up; the origin is the first breadcrumb. ``yaw`` is counter-clockwise from East (REP-103);
    a compass heading (clockwise from North) is only ever printed, under the name ``heading_deg``.
Body frame ``b``
    The device's own axes. ``mount`` is the body direction whose horizontal projection points where the person walks.
Names
    Poses ``nTb``, rotations ``nRb``, vectors ``acc_b``, ``mag_n``; ``k`` counts steps or breadcrumbs, ``i`` samples;
    ``sigma_*`` is a standard deviation, ``cov_*`` a covariance; quaternion order is in the name (``quat_wxyz``).

``ROOMS`` is the map of the house: a room imports only rooms before it in the list.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from fbgraph.api import OnlineSmoother as OnlineSmoother
    from fbgraph.api import Walk as Walk
    from fbgraph.api import load_run as load_run
    from fbgraph.api import log_from_dataframe as log_from_dataframe
    from fbgraph.api import simulate as simulate
    from fbgraph.api import smooth as smooth
    from fbgraph.batches.batch import batch as batch
    from fbgraph.calibration.calibrate_logs import calibrate as calibrate
    from fbgraph.core.building import Building as Building
    from fbgraph.core.checkpoints import Checkpoints as Checkpoints
    from fbgraph.core.config import Config as Config
    from fbgraph.core.config import load_config as load_config
    from fbgraph.core.errors import ConfigError as ConfigError
    from fbgraph.core.errors import DataError as DataError
    from fbgraph.core.errors import EstimationError as EstimationError
    from fbgraph.core.errors import FbgraphError as FbgraphError
    from fbgraph.core.sensor_log import SensorLog as SensorLog
    from fbgraph.core.trajectory import Trajectory as Trajectory
    from fbgraph.learning import learn_building as learn_building
    from fbgraph.readers import read_log as read_log
    from fbgraph.readers.places import read_checkpoints as read_checkpoints

__version__ = "0.1.0"

ROOMS = (
    "core",
    "workers",
    "tables",
    "columns",
    "physics",
    "readers",
    "simulator",
    "front_end",
    "way_back",
    "estimators",
    "integrity",
    "run",
    "exports",
    "plots",
    "recording",
    "study",
    "pipeline",
    "calibration",
    "inspection",
    "session",
    "live",
    "reruns",
    "learning",
    "batches",
    "api",
    "cli",
)
"""Folders and files of the package, from the ground up."""

_WHERE = {
    **dict.fromkeys(("OnlineSmoother", "Walk", "load_run", "log_from_dataframe", "simulate", "smooth"), "api"),
    "batch": "batches.batch",
    "calibrate": "calibration.calibrate_logs",
    "Building": "core.building",
    "Checkpoints": "core.checkpoints",
    **dict.fromkeys(("Config", "load_config"), "core.config"),
    **dict.fromkeys(("ConfigError", "DataError", "EstimationError", "FbgraphError"), "core.errors"),
    "SensorLog": "core.sensor_log",
    "Trajectory": "core.trajectory",
    "learn_building": "learning",
    "read_checkpoints": "readers.places",
    "read_log": "readers",
}
"""Names are imported when first asked for: ``fbgraph --help`` needs none of them."""

__all__ = [*_WHERE, "ROOMS", "__version__"]


def __getattr__(name: str) -> object:
    if name not in _WHERE:
        raise AttributeError(f"module 'fbgraph' has no attribute {name!r}")
    from importlib import import_module

    value = globals()[name] = getattr(import_module(f"fbgraph.{_WHERE[name]}"), name)
    return value


def __dir__() -> list[str]:
    return sorted({*globals(), *_WHERE})
