"""Errors of the estimators in a recording: at the checkpoints of the truth, and of the legs between them."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import rerun as rr

from fbgraph.core.colors import COLORS, LABELS
from fbgraph.core.errors import DataError
from fbgraph.core.geometry import FloatArray
from fbgraph.core.trajectory import Trajectory
from fbgraph.recording.map_frame import MOST_LABELS
from fbgraph.recording.writer import RrdWriter
from fbgraph.run.metrics import checkpoint_errors, leg_errors
from fbgraph.run.scores import score_label
from fbgraph.run.walk_result import WalkResult

_CIRCLE = rr.components.MarkerShape.Circle


def errors_at_checkpoints(
    result: WalkResult, trajectories: Sequence[tuple[str, Trajectory]]
) -> dict[str, tuple[FloatArray, FloatArray]]:
    """Times and horizontal errors at the truth's checkpoints, aligned as in scoring.

    Args:
        result: the walk, with its truth if there is one.
        trajectories: of the walk's estimators, by name, in the order in which they are drawn.

    Returns:
        By estimator: (M,) seconds on the log's clock and (M,) metres; empty without truth, and without an estimator to
        which the truth cannot be aligned.
    """
    if result.told.truth is None:
        return {}
    t_s = result.told.truth.t_s - result.log.t0_s
    errors = {}
    for name, trajectory in trajectories:
        _, alignment = score_label(name, result.told.anchors is not None, result.told.closed_walk)
        try:
            log = result.log
            error_m = checkpoint_errors(trajectory, result.told.truth, log.t0_s, alignment, log.span_s)
        except DataError:  # truth of another log; who scores complains, the recording shows what there is
            continue
        errors[name] = (t_s[len(t_s) - len(error_m) :], error_m)
    return errors


def record_errors(rrd: RrdWriter, result: WalkResult, errors: dict[str, tuple[FloatArray, FloatArray]]) -> None:
    """Write the errors at the checkpoints, and of each leg between two of them in length and direction.

    Args:
        rrd: where to; ``error_m/…`` in metres, ``legs/length_percent/…``, ``legs/direction_deg/…``.
        result: the walk, with its truth.
        errors: from ``errors_at_checkpoints``.
    """
    for name, (t_s, error_m) in errors.items():
        rrd.series(f"error_m/{name}", t_s, error_m, [LABELS[name]], [COLORS[name]], width=2.0)
        if len(t_s) <= MOST_LABELS:
            rrd.series(f"error_m/{name}_at", t_s, error_m, [LABELS[name]], [COLORS[name]], width=3.0, points=_CIRCLE)
        assert result.told.truth is not None  # there are errors
        legs = leg_errors(result.trajectories[name], result.told.truth, result.log.t0_s)
        edges_s = np.append(legs.start_s, legs.end_s[-1:])
        for what, values in (
            ("length_percent", 100.0 * legs.length_rel),
            ("direction_deg", np.degrees(legs.yaw_rad)),
        ):
            held = np.append(values, values[-1:])
            rrd.series(f"legs/{what}/{name}", edges_s, held, [LABELS[name]], [COLORS[name]], width=2.0, stairs=True)
