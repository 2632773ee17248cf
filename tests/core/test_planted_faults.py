"""Faults of one line are noticed: the dozen that every run of the tests plants (``scripts/mutants.py`` plants all)."""

import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).parents[2]


def test_planted_faults_are_noticed() -> None:
    command = [sys.executable, str(ROOT / "scripts" / "mutants.py"), "--ci"]
    done = subprocess.run(command, capture_output=True, text=True, cwd=ROOT)
    assert done.returncode == 0, done.stdout + done.stderr
    assert int(done.stdout.split()[0]) >= 12
