"""Text that would do something wherever it is not treated as data, and a terminal to show it on."""

import os
import pty
import re
import select
import subprocess
import sys
import time
import unicodedata
from pathlib import Path

TITLE = "\x1b]0;PWNED\x07"
CLIPBOARD = "\x1b]52;c;UFdORUQ=\x07"
CLEAR, RED_8BIT, RIGHT_TO_LEFT = "\x1b[2J", "\x9b31m", "\u202eRTL"
MARKUP = "[red]markup[/red] [link=http://x]l[/link]"
FORMULA, SCRIPT = "=cmd|' /C calc'!A0", "<script>document.title='PWNED'</script>"
INPUT, PICTURE = "\\input{/etc/passwd}", "![x](http://127.0.0.1:9/leak.png)"
TEXTS = (
    *(TITLE, CLIPBOARD, CLEAR, "\x07bell", RED_8BIT, RIGHT_TO_LEFT, MARKUP, FORMULA, SCRIPT, INPUT, PICTURE),
    *("a|b", "`code`", "nul\x00", "half\ud83d", "\udc9b31m", "A" * 10_000, "two\nlines\r", "]]>&amp;\"'", "$\\frac{"),
)


def unseen(text: str, allowed: str = "\n") -> set[str]:
    """Characters of a text that a terminal would obey instead of showing them."""
    return {c for c in text if unicodedata.category(c) in ("Cc", "Cf", "Cs") and c not in allowed}


def on_terminal(*arguments: object, code: int = 0, cwd: Path | None = None, term: str = "dumb") -> str:
    """What ``fbgraph`` sends to a terminal; all of it raw but for the terminal's own line ends.

    With ``term`` dumb fbgraph has no reason to send any escape; those for another one's colours and bars are taken off.
    """
    master, slave = pty.openpty()
    environment = {**os.environ, "TERM": term, "COLUMNS": "120", "LC_ALL": "C.UTF-8"}
    command = [sys.executable, "-m", "fbgraph", *map(str, arguments)]
    process = subprocess.Popen(
        command, stdin=subprocess.DEVNULL, stdout=slave, stderr=slave, cwd=cwd, env=environment, close_fds=True
    )
    os.close(slave)
    got, until = b"", time.monotonic() + 120.0
    while time.monotonic() < until:
        if select.select([master], [], [], 0.5)[0]:
            try:
                piece = os.read(master, 65536)
            except OSError:  # Linux: the last one closed the terminal
                break
            if not piece:
                break
            got += piece
    os.close(master)
    text = got.decode("utf-8", "surrogateescape").replace("\r\n", "\n")
    assert process.wait(30) == code, text
    assert "Traceback" not in text
    return text if term == "dumb" else re.sub(r"\x1b\[(\?25[lh]|[0-9;]*[mAK]|1?G|2K)|\r", "", text)
