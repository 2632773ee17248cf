#!/usr/bin/env python3
"""Writes scripts/example.ipynb from the cells of scripts/example.py: .venv/bin/python scripts/example_notebook.py."""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import Any

SOURCE = Path(__file__).with_name("example.py")


def cells(text: str) -> list[dict[str, Any]]:
    """Cells of a script in the percent format, as a notebook holds them; what stands before the first is left out."""
    found: list[dict[str, Any]] = []
    for number, part in enumerate(re.split(r"^# %%", text, flags=re.MULTILINE)[1:]):
        head, _, body = part.partition("\n")
        kind = "markdown" if "[markdown]" in head else "code"
        lines = body.strip("\n").splitlines(keepends=True)
        if kind == "markdown":
            lines = [line.removeprefix("#").removeprefix(" ") for line in lines]
        cell: dict[str, Any] = {"cell_type": kind, "id": f"cell-{number}", "metadata": {}, "source": lines}
        found.append(cell if kind == "markdown" else {**cell, "execution_count": None, "outputs": []})
    return found


def notebook() -> str:
    """The notebook as a file holds it."""
    kernel = {"display_name": "Python 3", "language": "python", "name": "python3"}
    whole = {"cells": cells(SOURCE.read_text("utf-8")), "metadata": {"kernelspec": kernel}}
    return json.dumps({**whole, "nbformat": 4, "nbformat_minor": 5}, indent=1, ensure_ascii=False) + "\n"


if __name__ == "__main__":
    SOURCE.with_suffix(".ipynb").write_text(notebook(), "utf-8")
