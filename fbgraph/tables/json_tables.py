"""Tables in JSON: a list of records, or a record a line; records that name their sensor make a table each.

Sensor Logger exports ``[{"sensor": "Accelerometer", "time": "1698…", "x": "0.1", …}]`` and sends
``{"payload": [{"name": "accelerometer", "time": 1698…, "values": {"x": 0.1, …}}]}``.
"""

from __future__ import annotations

import json
from collections.abc import Iterator
from typing import Any

from fbgraph.core.bounded import MOST_COLUMNS
from fbgraph.core.errors import DataError
from fbgraph.tables.fields import is_empty, kind, numbers_of, text_of_fields
from fbgraph.tables.log_text import LogText
from fbgraph.tables.table import Column, Table

MOST_JSON_BYTES = 1 << 28
"""Of JSON, whose records take twenty times as much memory as they are long."""
_WHAT = ("sensor", "name", "type")


def is_json(text: LogText) -> bool:
    """Whether a text begins as JSON does that holds records."""
    return text.head(200).lstrip()[:1] in ("[", "{") and '"' in text.head(2000)


def json_tables(text: LogText, name: str, source: str) -> tuple[Table, ...]:
    """The tables of a JSON text; none if it holds no records.

    Raises:
        DataError: it is larger than any recording, or has more columns.
    """
    size = sum(len(piece) for piece in text.pieces)
    if size > MOST_JSON_BYTES and not text.any_rows:
        raise DataError(f"{source}: {size >> 20} MiB of JSON, the limit is {MOST_JSON_BYTES >> 20}; export CSV instead")
    records: dict[str, list[dict[str, Any]]] = {}
    bad = 0
    for record in _records(b"".join(text.pieces)):
        if record is None:
            bad += 1
            continue
        flat = _flat(record)
        what = next((flat.pop(key) for key in _WHAT if isinstance(flat.get(key), str)), name)
        records.setdefault(what, []).append(flat)
    counts = {"lines_unreadable": bad} if bad else {}
    return tuple(
        Table(what, source, _columns(rows, source), True, "JSON", None, (), counts) for what, rows in records.items()
    )


def _records(data: bytes) -> Iterator[dict[str, Any] | None]:
    """The records of a document or of its lines; None for a line that is none."""
    try:
        yield from _inside(json.loads(data))
        return
    except (ValueError, RecursionError):
        pass
    for line in data.split(b"\n"):
        if line.strip().strip(b"[],"):
            try:
                yield from _inside(json.loads(line.strip().rstrip(b",")))
            except (ValueError, RecursionError):
                yield None


def _inside(value: Any) -> Iterator[dict[str, Any]]:
    """The records of a value: itself, of its list, or of the list under ``payload`` or the like."""
    if isinstance(value, list):
        for each in value:
            yield from _inside(each) if isinstance(each, dict) else ()
    elif isinstance(value, dict):
        inner = [each for each in value.values() if isinstance(each, list) and each and isinstance(each[0], dict)]
        if inner:
            for each in inner:
                yield from _inside(each)
        else:
            yield value


def _flat(record: dict[str, Any]) -> dict[str, Any]:
    """A record with those inside it spread out, under their own names where these are free."""
    flat: dict[str, Any] = {}
    for key, value in record.items():
        if isinstance(value, dict):
            for inner, each in value.items():
                if not isinstance(each, dict | list):
                    flat[inner if inner not in flat and inner not in record else f"{key}.{inner}"] = each
        elif not isinstance(value, list):
            flat[key] = value
    return flat


def _columns(rows: list[dict[str, Any]], source: str) -> tuple[Column, ...]:
    names = list(dict.fromkeys(key for row in rows for key in row))
    if len(names) > MOST_COLUMNS:
        raise DataError(f"{source}: records of {len(names)} names, of which a log has {MOST_COLUMNS} at most")
    columns = []
    for name in names:
        fields = [_text(row.get(name)) for row in rows]
        numbers = kind([field for field in fields if not is_empty(field)][:2000]) == "number"
        values = numbers_of(fields) if numbers else text_of_fields(fields)
        columns.append(Column(name, "", values.array, values.unreadable))
    return tuple(columns)


def _text(value: Any) -> str:
    return "" if value is None else value if isinstance(value, str) else json.dumps(value)
