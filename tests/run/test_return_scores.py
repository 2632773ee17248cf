"""The way back scored as in the README, on real and simulated walks."""

from pathlib import Path

import numpy as np
import pytest

from fbgraph.core.config import load_config
from fbgraph.core.errors import DataError
from fbgraph.readers import preset, read_log
from fbgraph.run.return_scores import (
    ReturnScore,
    SimulatedReturnScore,
    follow_back,
    passes,
    random_return_route,
    retraced_m,
    score_return,
    score_simulated_return,
)
from fbgraph.simulator.simulate import simulate


@pytest.fixture(scope="module")
def museum(shared_data: Path) -> list[ReturnScore]:
    walks = []
    for path in sorted((shared_data / "ipin2023").glob("*.gz")):
        log_file = read_log(path)
        log, truth = log_file.log, log_file.truth
        assert truth is not None
        walks.append(score_return(log, truth.xy_m, truth.t_s - log.t0_s, load_config(preset(log.format)), piece_s=0.5))
    return walks


def test_places_of_the_way_back_are_known_in_the_museum(museum: list[ReturnScore]) -> None:
    assert len(museum) == 8
    told, by_itself = np.concatenate([w.told_m for w in museum]), np.concatenate([w.auto_m for w in museum])
    assert np.isfinite(told).all()
    assert np.isfinite(by_itself).mean() > 0.7  # some checkpoints are passed before it can know
    for error_m in (told, by_itself[np.isfinite(by_itself)]):
        assert error_m.mean() <= 1.5
        assert np.percentile(error_m, 95) <= 4.0


def test_turning_back_and_arriving_are_noticed_in_the_museum(museum: list[ReturnScore]) -> None:
    assert max(w.turn_off_s for w in museum) < 10.0
    assert max(w.delay_s for w in museum) < 15.0
    assert max(w.arrived_m for w in museum) < 4.2  # returning.arrived_m and a step
    assert all(np.isfinite(w.arrived_m) for w in museum)


def test_nothing_wrong_is_told_in_the_museum(museum: list[ReturnScore]) -> None:
    assert sum(w.off_route for w in museum) == 0
    assert sum(w.closures for w in museum) > 50
    assert sum(w.wrong for w in museum) == 0


def simulated_return(seed: int, detour: bool) -> SimulatedReturnScore:
    route, span = random_return_route(seed, detour)
    walk = simulate(route, seed=seed)
    passed_s = walk.checkpoints.t_s - walk.log.t0_s
    turned_s = float(passed_s[np.argmax(route.pause_s > 0)])
    returned = follow_back(walk.log, load_config("m5stickc"), f"{turned_s:.3f}")
    return score_simulated_return(
        walk, returned, turned_s, None if span is None else (passed_s[span[0]], passed_s[span[1]])
    )


@pytest.mark.parametrize("seed", range(3))
def test_simulated_out_and_back(seed: int) -> None:
    found = simulated_return(seed, detour=False)
    assert found.false_off == 0
    assert found.error_m.mean() < 1.0
    assert found.arrived_m < 4.0
    assert found.wrong == 0
    assert np.isnan(found.flagged_after_m)


@pytest.mark.parametrize("seed", [0, 5, 25])
def test_a_detour_is_noticed_and_the_route_found_again(seed: int) -> None:
    found = simulated_return(seed, detour=True)
    assert found.false_off == 0
    assert found.flagged_after_m < 10.0
    assert found.back_after_m < 10.0
    assert found.arrived_m < 4.0
    assert found.wrong == 0


def test_which_checkpoint_repeats_which() -> None:
    """Out over A B C, a pause, back to A, and out again to B."""
    a, b, c = (0.0, 0.0), (5.0, 0.0), (5.0, 5.0)
    assert passes(np.array((a, b, c, c, b, a, a, b))) == (2, [(2, 3), (1, 4), (0, 5), (0, 6), (1, 7)])
    for others in ((a, b, c), (a, b, b, c)):
        with pytest.raises(DataError, match="not a walk out and back"):
            passes(np.array(others))


def test_how_far_a_walk_goes_back_over_its_own_way() -> None:
    assert retraced_m(np.array(((0.0, 0.0), (30.0, 0.0), (30.0, 20.0)))) < 4.0
    assert retraced_m(np.array(((0.0, 0.0), (30.0, 0.0), (12.0, 0.0)))) == pytest.approx(18.0, abs=1.0)
