"""Text from outside by its way out: what it looks like there."""

import csv
import io
import json
import unicodedata
from xml.etree import ElementTree

import pytest
from support.hostile import TEXTS, unseen

from fbgraph.core.safe_text import (
    MOST_LINE,
    MOST_NAME,
    for_csv,
    for_json,
    for_latex,
    for_markdown,
    for_terminal,
    for_xml,
    short_name,
    visible,
)

ORDINARY = (
    "walk_01",
    "Café <3 m²",
    "TrainingTrial22_repetition02",
    "東京 駅",
    "10 % of 3 °",
    "a – b … “c”",
    "x\u00a0y",
    "",
)


@pytest.mark.parametrize(
    ("text", "shown"),
    [
        ("\x1b[2J", r"\x1b[2J"),
        ("\x9b31m", r"\x9b31m"),
        ("\x7f\x07\x00", r"\x7f\x07\x00"),
        ("\u202eabc\u2066\u200b\ufeff", r"\u202eabc\u2066\u200b\ufeff"),
        ("a\nb\rc\td\u2028e", r"a\nb\rc\td\u2028e"),
        ("\udc9b\ud83d", r"\udc9b\ud83d"),
        ("\U000e0041", r"\U000e0041"),
        (r"C:\new", r"C:\new"),
    ],
)
def test_what_is_not_seen_is_spelled_out(text: str, shown: str) -> None:
    assert visible(text) == shown
    assert for_terminal(text) == for_xml(text) == shown
    assert visible(shown) == shown


@pytest.mark.parametrize("text", ORDINARY)
def test_ordinary_text_stays_as_it_is(text: str) -> None:
    assert visible(text) == for_terminal(text) == short_name(text) == for_csv(text) == for_xml(text) == text
    assert for_json(text) == text


def test_lines_of_a_document_stay_lines() -> None:
    assert visible("a\nb\x1b\n", keep="\n") == "a\nb\\x1b\n"


def test_names_and_lines_are_cut() -> None:
    assert short_name("A" * MOST_NAME) == "A" * MOST_NAME
    assert short_name("A" * 10_000) == "A" * (MOST_NAME - 1) + "…"
    assert for_terminal("A" * 10_000) == "A" * (MOST_LINE - 1) + "…"
    assert len(short_name("\x1b" * MOST_NAME)) == MOST_NAME


@pytest.mark.parametrize(
    ("text", "shown"),
    [
        ("walk_01_b", "walk_01_b"),
        ("_emphasis_", r"\_emphasis\_"),
        ("**b** `c`", r"\*\*b\*\* \`c\`"),
        ("![x](http://h/p.png)", r"!\[x\](http\://h/p.png)"),
        ("<img src=x>", r"\<img src=x\>"),
        ("a|b", r"a\|b"),
        ("&lt; a & b", r"\&lt; a & b"),
        ("# title", r"\# title"),
        ("- point", r"\- point"),
        ("a - b # c!", "a - b # c!"),
        ("a\n# b", r"a\\n# b"),
        (r"\[", r"\\\["),
    ],
)
def test_markdown_shows_what_would_be_markup(text: str, shown: str) -> None:
    assert for_markdown(text) == shown


@pytest.mark.parametrize(
    ("text", "shown"),
    [
        (r"\input{/etc/passwd}", r"\textbackslash{}input\{/etc/passwd\}"),
        ("50 % & a_b #1 $x$", r"50 \% \& a\_b \#1 \$x\$"),
        ("^^5cinput ~", r"\textasciicircum{}\textasciicircum{}5cinput \textasciitilde{}"),
        ("a\nb", r"a\textbackslash{}nb"),
        ("0.6–1.3 3 °", r"0.6--1.3 3 $^\circ$"),
        ("<a|b>", r"\textless{}a\textbar{}b\textgreater{}"),
    ],
)
def test_latex_sees_no_command(text: str, shown: str) -> None:
    assert for_latex(text) == shown


@pytest.mark.parametrize("text", ["=1+1", "+cmd", "-2+3+cmd", "@SUM(A1)", " =1", "＝1+1", "-", "=1.5"])
def test_a_spreadsheet_runs_no_cell(text: str) -> None:
    assert for_csv(text) == f"'{text}"


@pytest.mark.parametrize(("text", "shown"), [("\t=1", "\\t=1"), ("\r=1", "\\r=1"), ("\n=1", "\\n=1")])
def test_a_cell_cannot_hide_its_formula_behind_unseen_characters(text: str, shown: str) -> None:
    assert for_csv(text) == shown


@pytest.mark.parametrize("text", ["-1.5", "+2", "-1e-3", "3", "a=b", "trial-1"])
def test_numbers_and_ordinary_cells_are_left_alone(text: str) -> None:
    assert for_csv(text) == text


@pytest.mark.parametrize("text", TEXTS)
def test_every_way_out_is_safe_of_every_text(text: str) -> None:
    for made in (for_terminal(text), short_name(text), for_markdown(text), for_latex(text), for_csv(text)):
        assert unseen(made, allowed="") == set()
        made.encode()
    cell = io.StringIO()
    csv.writer(cell).writerow([for_csv(text)])
    [[read]] = csv.reader(io.StringIO(cell.getvalue(), newline=""))
    assert read == for_csv(text)
    assert read[0] not in "=+-@\t\r"
    element = ElementTree.Element("name")
    element.text = for_xml(text)
    assert ElementTree.fromstring(ElementTree.tostring(element)).text == for_xml(text)
    document = for_json(json.dumps({"a": text}, ensure_ascii=False, indent=1))
    assert json.loads(document) == {"a": text}
    assert unseen(document) == set()
    document.encode()


def test_no_character_at_all_gets_through() -> None:
    everything = "".join(map(chr, range(0x110000)))
    shown = visible(everything)
    assert {unicodedata.category(c) for c in shown}.isdisjoint({"Cc", "Cf", "Cs", "Zl", "Zp", "Co", "Cn"})
    assert json.loads(for_json(json.dumps(everything[:0xD800], ensure_ascii=False))) == everything[:0xD800]
