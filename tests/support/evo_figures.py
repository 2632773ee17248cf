"""What ``evo_ape tum TRUTH ESTIMATE`` says, without a flag."""

from pathlib import Path

from evo.core import metrics, sync
from evo.tools import file_interface


def evo_ape(truth: Path, estimate: Path) -> dict[str, float]:
    """evo's statistics: pairs within its usual 10 ms, translations as they are, in three dimensions."""
    pair = (file_interface.read_tum_trajectory_file(path) for path in (truth, estimate))
    ape = metrics.APE(metrics.PoseRelation.translation_part)
    ape.process_data(sync.associate_trajectories(*pair))
    return {**ape.get_all_statistics(), "pairs": float(len(ape.error))}
