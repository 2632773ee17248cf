"""Formats whose lines are tagged, each with a reader of its own."""

from __future__ import annotations

from collections.abc import Sequence
from importlib import import_module
from types import ModuleType

TAGGED = ("getsensordata", "indoor_location")
"""In the order in which detection asks them."""


def tagged_reader(head: str, asked: Sequence[str] = TAGGED) -> ModuleType | None:
    """The reader of a format whose lines are tagged; None if a text is of none of them.

    Args:
        head: how the text begins.
        asked: formats that it may be.
    """
    return next((reader for name in asked if (reader := reader_of(name)).detects(head)), None)


def reader_of(name: str) -> ModuleType:
    """The module that reads a format of ``TAGGED``."""
    return import_module(f"fbgraph.readers.{name}")
