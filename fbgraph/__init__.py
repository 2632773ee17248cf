"""fbgraph: where somebody walked, from the sensors alone.

ForestBack's breadcrumb dead reckoning rebuilt as a factor graph on GTSAM.

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
    x East, y North, z up; the origin is the first breadcrumb. ``yaw`` is counter-clockwise from East (REP-103).
    A compass heading (clockwise from North) is only ever printed, under the name ``heading_deg``.
Body frame ``b``
    The device's own axes. ``mount`` is the body direction whose horizontal projection points where the person walks.
Names
    Poses ``nTb``, rotations ``nRb``, vectors ``acc_b``, ``mag_n``; ``k`` counts steps or breadcrumbs, ``i`` samples;
    ``sigma_*`` is a standard deviation, ``cov_*`` a covariance; quaternion order is in the name (``quat_wxyz``).
"""

__version__ = "0.1.0"
