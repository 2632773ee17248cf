"""One colour per estimator, in the recording and in every figure. Imports nothing, so that anyone may ask.

Okabe and Ito's colours, told apart by colour-blind readers. All are legible on black and, yellow aside (which no
estimator has), on white.
"""

from __future__ import annotations

Color = tuple[int, int, int]

COLORS: dict[str, Color] = {
    "pdr": (230, 159, 0),  # orange
    "ekf": (86, 180, 233),  # sky blue
    "smoothed": (0, 158, 115),  # bluish green
    "online": (204, 121, 167),  # reddish purple
    "logged_pdr": (213, 94, 0),  # vermilion, never in one picture with a sensor
    "logged_forestback": (0, 114, 178),  # blue
    "truth": (153, 153, 153),  # grey
    "anchor": (240, 228, 66),  # yellow, never in one picture with steps
    "step": (240, 228, 66),
    "closure": (0, 114, 178),  # blue: two breadcrumbs at one place
    "event": (200, 200, 200),
    "return": (0, 114, 178),  # the way back
    "sensor": (213, 94, 0),  # vermilion: what a sensor says by itself (compass, barometer, |acc|)
}
"""By estimator name (``result.ESTIMATORS``), and of what they are made from and compared with; sRGB, 0 to 255."""

AXIS_COLORS: tuple[Color, Color, Color] = ((213, 94, 0), (240, 228, 66), (0, 114, 178))
"""Of the body axes x, y, z: none of them an estimator's colour."""

LABELS: dict[str, str] = {"pdr": "PDR", "ekf": "EKF", "smoothed": "smoothed", "online": "online"}
"""What a legend calls each estimator."""

RUN_COLORS: tuple[Color, ...] = (
    COLORS["return"],  # blue
    COLORS["sensor"],  # vermilion
    *(COLORS[name] for name in ("smoothed", "online", "pdr", "ekf")),
)
"""Of runs compared in one figure, where one estimator of each is drawn; first those that are no estimator's."""
