"""Damaged files give a result or one clear line: a few of the cases of ``scripts/fuzz.py``."""

import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).parents[1]


def test_damage_gives_a_result_or_one_clear_line() -> None:
    command = [sys.executable, str(ROOT / "scripts" / "fuzz.py"), "--seconds", "8", "--processes", "1"]
    done = subprocess.run(command, capture_output=True, text=True, cwd=ROOT, check=False)
    assert done.returncode == 0, done.stdout + done.stderr
    assert int(done.stdout.splitlines()[-1].split()[0]) >= 10
