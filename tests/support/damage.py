"""Damage to the files of a folder, as disks, editors and interrupted copies do it."""

import copy
import json
import random
import re
from pathlib import Path
from typing import Any

NUMBER = re.compile(rb"-?\d+\.?\d*(?:e[+-]?\d+)?")
NUMBERS = (b"nan", b"inf", b"-inf", b"1e15", b"-1", b"0", b"1e999", b"")
WRONG: tuple[Any, ...] = (
    None,
    True,
    "x",
    "",
    [],
    {},
    [1],
    {"x": 1},
    -1,
    0,
    1.5,
    1e15,
    -1e300,
    10**400,
    "\x00",
    "\ud800",
)


def damage(path: Path, rng: random.Random) -> str:
    """Damage a file in a way of the generator's choice; returns what was done."""
    kinds = ["cut", "flip", "lines", "number", "remove"] + (["json"] * 5 if path.suffix == ".json" else [])
    kind, data = rng.choice(kinds), path.read_bytes()
    at = rng.randrange(len(data))
    if kind == "cut":
        data = data[:at]
    elif kind == "flip":
        data = data[:at] + bytes([data[at] ^ 1 << rng.randrange(8)]) + data[at + 1 :]
    elif kind == "lines":
        data = _other_lines(data, rng)
    elif kind == "number":
        found = rng.choice(list(NUMBER.finditer(data)))
        data = data[: found.start()] + rng.choice(NUMBERS) + data[found.end() :]
    elif kind == "json":
        data = json.dumps(wrong_somewhere(json.loads(data), rng)).encode()
    path.write_bytes(data)
    if kind == "remove":
        path.unlink()
    return f"{kind} at {at}"


def _other_lines(data: bytes, rng: random.Random) -> bytes:
    lines = data.splitlines(keepends=True)
    a, b = rng.randrange(len(lines)), rng.randrange(len(lines))
    match rng.randrange(3):
        case 0:
            del lines[a]
        case 1:
            lines.insert(b, lines[a])
        case _:
            lines[a], lines[b] = lines[b], lines[a]
    return b"".join(lines)


def places(value: Any, path: tuple[Any, ...] = ()) -> list[tuple[Any, ...]]:
    """Every path in a JSON value, the value itself left out."""
    keys = value.keys() if isinstance(value, dict) else range(len(value)) if isinstance(value, list) else ()
    return [found for key in keys for found in ((*path, key), *places(value[key], (*path, key)))]


def with_value(document: Any, path: tuple[Any, ...], value: object) -> Any:
    """The document with another value at a path."""
    changed = copy.deepcopy(document)
    inner = changed
    for key in path[:-1]:
        inner = inner[key]
    inner[path[-1]] = value
    return changed


def wrong_somewhere(document: Any, rng: random.Random) -> Any:
    """The document with a wrong value at some path."""
    return with_value(document, rng.choice(places(document)), rng.choice(WRONG))
