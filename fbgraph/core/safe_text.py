"""Text from outside is data: what somebody wrote into a log or its name is shown, and never does anything.

Names, event labels, headers, remarks and what a ``summary.json`` says come from whoever wrote the file. Each way out
has its function here; files that hold the data itself (``summary.json``, GeoJSON) keep the text as it was.
"""

from __future__ import annotations

import re
import unicodedata

MOST_NAME = 120
"""Characters of a name or label in a sentence; the rest is cut."""
MOST_LINE = 2000
"""Characters of a line."""

_MARKDOWN = re.compile(
    r"""
    [\\`*\[\]<>|~$]
    | &(?=[\#\w])  # an entity
    | :(?=//)  # a link
    | (?<![^\W_])_ | _(?![^\W_])  # inside of words it is a letter
    | ^[-+=\#]  # list, heading
    """,
    re.VERBOSE,
)
_LATEX = str.maketrans(
    {
        **{c: f"\\{c}" for c in "{}$&#_%"},
        **{"\\": r"\textbackslash{}", "~": r"\textasciitilde{}", "^": r"\textasciicircum{}"},
        **{"<": r"\textless{}", ">": r"\textgreater{}", "|": r"\textbar{}"},
        **{"–": "--", "°": r"$^\circ$", "…": r"\ldots{}"},
    }
)
_FORMULA = tuple("=+-@＝＋－＠")
"""What a spreadsheet takes for the beginning of a formula; East Asian ones take the wide forms too."""


def visible(text: str, keep: str = "") -> str:
    r"""Characters that are not seen but do something are spelled out: ``\x1b``, ``\u202e``, ``\n``, ``\udc9b``.

    Control characters, escapes, marks of direction and format, halves of surrogate pairs, unassigned characters.

    Args:
        text: anything.
        keep: characters to leave as they are.
    """
    if text.isprintable():
        return text
    return "".join(c if _shows(c) or c in keep else c.encode("unicode_escape").decode() for c in text)


def for_terminal(text: str, most: int = MOST_LINE) -> str:
    """One line that moves no cursor and sets no title, cut to ``most`` characters."""
    shown = visible(text[: most + 1])
    return shown if len(shown) <= most else f"{shown[: most - 1]}…"


def short_name(text: str) -> str:
    """A name or label in a line of other words."""
    return for_terminal(text, MOST_NAME)


def for_markdown(text: str, most: int = MOST_LINE) -> str:
    """One line that is no markup, link, picture or end of a table's cell."""
    return _MARKDOWN.sub(r"\\\g<0>", for_terminal(text, most))


def for_latex(text: str, most: int = MOST_LINE) -> str:
    """One line without commands; needs no package."""
    return for_terminal(text, most).translate(_LATEX)


def for_csv(text: str) -> str:
    """A cell that no spreadsheet runs: what begins like a formula and is no number gets an apostrophe before it."""
    shown = visible(text)
    return f"'{shown}" if shown.lstrip().startswith(_FORMULA) and not is_number(shown) else shown


def for_xml(text: str) -> str:
    """Without the characters that XML forbids, or that are not seen; who writes the XML escapes its markup."""
    return visible(text)


def in_template(value: object) -> object:
    """What a page's template shows: of text, no character that does something unseen; it escapes markup itself."""
    return visible(value, keep="\n") if type(value) is str else value


def for_json(document: str) -> str:
    """The same JSON, every unseen character in it as its escape: it can be shown, and written in any encoding."""
    if document.isprintable():
        return document
    return "".join(c if _shows(c) or c == "\n" else _json_escape(c) for c in document)


def _shows(c: str) -> bool:
    return c.isprintable() or unicodedata.category(c) == "Zs"  # spaces of any width


def _json_escape(c: str) -> str:
    digits = c.encode("utf-16-be", "surrogatepass").hex()
    return "".join(f"\\u{digits[i : i + 4]}" for i in range(0, len(digits), 4))


def is_number(text: str) -> bool:
    """Whether Python reads a text as a number."""
    try:
        float(text)
    except ValueError:
        return False
    return True
