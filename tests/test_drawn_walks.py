"""A part of the study of ``scripts/integrity.py``: what it must show, and that it would show the contrary."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from judged_walks import KINDS, Judged, ellipse_sigmas, errors_m, figures, judged, row, share
from support.simulated import perfect
from support.trajectories import trajectory

import fbgraph.pipeline
from fbgraph.core.trajectory import Trajectory
from fbgraph.core.verdict import Integrity
from fbgraph.integrity.assess import Assessment
from fbgraph.integrity.evidence import Evidence

PART = range(7, 2000, 40)


@pytest.fixture(scope="module")
def part() -> list[Judged]:
    return [judged(seed) for seed in PART]


class TestPart:
    def test_truth_is_in_the_ellipses_of_sound_walks(self, part: list[Judged]) -> None:
        found = figures(part)
        assert 0.75 <= found["inside"] <= 0.99  # of few walks: each is inside, or outside, for much of its way
        assert found["inside_z"] >= 0.80

    def test_no_sound_walk_is_far_from_its_truth(self, part: list[Judged]) -> None:
        assert figures(part)["beyond"] <= 0.02

    def test_nothing_is_doubted_where_nothing_is_wrong(self, part: list[Judged]) -> None:
        assert figures(part)["alarms"] <= 0.01

    def test_sound_walks_are_worth_something(self, part: list[Judged]) -> None:
        quiet = [walk for walk in part if walk.kind in ("undisturbed", "other cadence", "out and back")]
        assert len(quiet) >= 8
        assert np.median([walk.sigma_m for walk in quiet]) < 6.0

    def test_most_kinds_are_drawn(self, part: list[Judged]) -> None:
        drawn = {walk.kind for walk in part}
        assert drawn <= {kind.name for kind in KINDS}
        assert len(drawn) >= 0.5 * len(KINDS)


def walk_of(seed: int, verdict: str, **changes: Any) -> Judged:
    return replace(Judged(seed, "undisturbed", True, "", verdict, (), breadcrumbs=100), **changes)


def ellipses(cov_xy: Any, count: int = 5) -> Trajectory:
    cov = np.zeros((count, 3, 3))
    cov[:, :2, :2] = cov_xy
    return replace(trajectory(np.zeros(count - 1)), cov_xy_yaw=cov, sigma_z_m=np.ones(count))


class TestJudging:
    """The study's own arithmetic."""

    def test_errors_are_counted_in_their_own_sigma(self) -> None:
        off = np.array([(2.0, 0.0), (0.0, 2.0), (1.0, 1.0), (0.0, 0.0), (-4.0, 0.0)])
        assert ellipse_sigmas(off, ellipses(((4.0, 0.0), (0.0, 1.0))), 0.0) == pytest.approx([1, 2, 1.25**0.5, 0, 2])
        assert ellipse_sigmas(off, ellipses(((1.75, 0.0), (0.0, 0.75))), 0.5)[:2] == pytest.approx([2**0.5, 2.0])
        long = ellipse_sigmas(off, ellipses(((5.0, 4.0), (4.0, 5.0))), 0.0)[2]
        assert long == pytest.approx((2.0 / 9.0) ** 0.5)

    def test_errors_begin_at_the_first_breadcrumb_unless_places_are_known(self) -> None:
        walk = perfect()
        smoothed = replace(trajectory(np.zeros(3)), x_m=np.full(4, 7.0), y_m=np.zeros(4), z_m=np.full(4, 2.0))
        assert errors_m(smoothed, walk, walk.log.t0_s, absolute=False) == pytest.approx(np.zeros((4, 3)))
        absolute = errors_m(smoothed, walk, walk.log.t0_s, absolute=True)
        assert absolute == pytest.approx(np.tile((7.0, 0.0, 0.0), (4, 1)))

    def test_shares_are_of_breadcrumbs(self) -> None:
        walks = [walk_of(1, "sound", inside=1.0, breadcrumbs=300), walk_of(2, "sound", inside=0.5)]
        assert share(walks, "inside") == pytest.approx(0.875)

    def test_figures(self) -> None:
        walks = [
            walk_of(1, "sound", worst_sigma=3.9, inside=0.9),
            walk_of(2, "sound", worst_z_sigma=4.1),
            walk_of(3, "doubtful", worst_sigma=50.0, inside=0.0),
            walk_of(4, "withheld", quiet=False),
            walk_of(5, "withheld", quiet=False),
        ]
        found = figures(walks)
        assert found["inside"] == pytest.approx(0.95)
        assert found["beyond"] == pytest.approx(1 / 2)
        assert found["alarms"] == pytest.approx(1 / 3)
        assert row("all", walks).split("|")[1:6] == [" all ", " 5 ", " 2 ", " 1 ", " 2 "]
        assert row("all", walks).endswith("| 1: 2 | 1: 3 |")

    def test_a_walk_that_believes_itself_too_much_is_found_out(self, monkeypatch: pytest.MonkeyPatch) -> None:
        def sure(walk: Evidence) -> Assessment:
            smoothed = walk.smoothed.trajectory
            assert smoothed.cov_xy_yaw is not None
            return Assessment(Integrity(), replace(smoothed, cov_xy_yaw=smoothed.cov_xy_yaw / 1e4))

        honest = judged(1, "undisturbed")
        monkeypatch.setattr(fbgraph.pipeline, "assess", sure)
        walk = judged(1, "undisturbed")
        assert (honest.far, walk.far) == (False, True)
        assert walk.inside < 0.5 < honest.inside

    def test_the_same_seed_is_the_same_walk(self) -> None:
        first, second = judged(7), judged(7)
        assert replace(first, seconds=0.0) == replace(second, seconds=0.0)
