"""What became of one item: what the function returned, or why it did not, as a cause that can be counted."""

from __future__ import annotations

import errno
import time
import traceback
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any, Generic, TypeVar, cast

from fbgraph.core.errors import ConfigError, DataError, EstimationError, FbgraphError

Item = TypeVar("Item")
Value = TypeVar("Value")

TIME_OUT, MEMORY, DIED, SYSTEM, UNEXPECTED = "time-out", "memory", "died", "system", "unexpected"
_CAUSES: tuple[tuple[type[BaseException], str], ...] = (
    (ConfigError, "config"),
    (DataError, "data"),
    (EstimationError, "estimation"),
    (MemoryError, MEMORY),
    (OSError, SYSTEM),
)
AGAIN = (DIED, SYSTEM)
"""Causes that may be gone the next time; all others would come again."""


@dataclass(frozen=True)
class Outcome(Generic[Value]):
    """What became of an item.

    Attributes:
        number: of the item, from 0, in the order in which they were given.
        value: what the function returned; None if it did not.
        cause: ``""`` if it returned; else ``config``, ``data``, ``estimation`` (what fbgraph can explain),
            ``time-out``, ``memory``, ``died`` (its process ended), ``system`` (a disk, a network) or ``unexpected``.
        reason: a sentence.
        wall_s, cpu_s: that it took, seconds; of CPU only where it came to its end.
        tries: how often it was begun.
    """

    number: int
    value: Value | None
    cause: str = ""
    reason: str = ""
    wall_s: float = 0.0
    cpu_s: float = 0.0
    tries: int = 1

    def tried(self, number: int, tries: int) -> Outcome[Value]:
        """The same of the item of this number, at this try."""
        return replace(self, number=number, tries=tries)

    def required(self) -> Value:
        """What the function returned.

        Raises:
            FbgraphError: it did not; of the kind that it was.
        """
        if self.cause:
            kind = next((kind for kind, name in _CAUSES if name == self.cause and issubclass(kind, FbgraphError)), None)
            raise (kind or FbgraphError)(self.reason)
        return cast("Value", self.value)


def attempt(function: Callable[[Item], Value], item: Item) -> Outcome[Value]:
    """Call a function; whatever it raises becomes an outcome, so that it can travel between processes."""
    wall, cpu = time.perf_counter(), time.process_time()
    try:
        value, cause, reason = function(item), "", ""
    except BaseException as error:  # of a function that would exit too
        value, cause, reason = None, *explained(error)
    return Outcome(0, value, cause, reason, time.perf_counter() - wall, time.process_time() - cpu)


def explained(error: BaseException) -> tuple[str, str]:
    """Cause and reason of an exception."""
    cause = next((name for kind, name in _CAUSES if isinstance(error, kind)), UNEXPECTED)
    text = str(error).strip()
    if isinstance(error, FbgraphError):
        return cause, text
    if cause == MEMORY or getattr(error, "errno", None) == errno.ENOMEM:
        return MEMORY, "needs more memory than it may have"
    where = traceback.extract_tb(error.__traceback__)
    at = f" ({where[-1].filename.rpartition('/')[2]}, line {where[-1].lineno})" if where else ""
    return cause, f"{type(error).__name__}: {text}{at}" if text else f"{type(error).__name__}{at}"


def stopped(seconds: float) -> Outcome[Any]:
    """Of an item that took longer than it may."""
    return Outcome(0, None, TIME_OUT, f"not done after {seconds:g} s, and stopped", seconds)


def died(how: str) -> Outcome[Any]:
    """Of an item whose process ended."""
    return Outcome(0, None, DIED, how)
