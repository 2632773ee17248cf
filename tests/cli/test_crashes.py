"""Nothing is lost when a disk fails or a process is killed: a part of what ``scripts/crash_tests.py`` tries."""

import shutil
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]


@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="calls are made to fail as only Linux allows")
@pytest.mark.skipif(shutil.which("cc") is None, reason="the failing disk needs a C compiler")
def test_what_must_stay_stays_whatever_fails() -> None:
    some = ["--case", "smooth over", "live, resumed", "--part", "2", "--kills", "2"]  # all of them take hours
    command = [sys.executable, str(ROOT / "scripts" / "crash_tests.py"), *some]
    done = subprocess.run(command, capture_output=True, text=True, cwd=ROOT, check=False)
    assert done.returncode == 0, done.stdout + done.stderr
    assert done.stdout.splitlines()[-1] == "4 failing calls and 2 kills, 0 times something was wrong"
