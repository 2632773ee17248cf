"""What closures do to the graph."""

import gtsam
import numpy as np
from gtsam.symbol_shorthand import X

from fbgraph.estimators.aid_factors import closure_factor
from fbgraph.way_back.records import Closure


def test_closure_factor_is_zero_at_the_place_it_names() -> None:
    closure = Closure(2, 9, 1.0, 0.5, along_m=0.3)
    values = gtsam.Values()
    values.insert(X(2), gtsam.Pose2(1.0, 2.0, 0.5))
    there = gtsam.Pose2(1.0, 2.0, 0.5).transformFrom(np.array((0.3, 0.0)))
    values.insert(X(9), gtsam.Pose2(there[0], there[1], 0.5 + np.pi + 0.4))
    assert closure_factor(closure).error(values) < 1e-4  # whatever the direction
    values.update(X(9), gtsam.Pose2(there[0] + 30.0, there[1], 0.5 + np.pi))
    assert closure_factor(closure).error(values) < 5.0  # a wrong match does not pull for ever
