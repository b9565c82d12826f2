"""Markup: what is not markup is text, and stays text."""

import html as standard

import pytest

from desim_uav.report.markup import Html, facts, html, table, tag, visible

HOSTILE = ("</style><script>alert(1)</script>", '" onload="x', "'", "&lt;", "<!--", "]]>")


@pytest.mark.parametrize("text", HOSTILE)
def test_a_text_is_a_text(text):
    made = tag("p", text, title=text)
    assert made == f'<p title="{standard.escape(text)}">{standard.escape(text)}</p>'
    assert standard.unescape(html(text)) == text
    assert html(Html(text)) == text


@pytest.mark.parametrize(
    ("text", "seen"),
    [
        ("plain, à 3 × 4 … ≠", "plain, à 3 × 4 … ≠"),
        ("a\u202eb", "a\\u202eb"),
        ("\u2066\u200b\ufeff", "\\u2066\\u200b\\ufeff"),
        ("\x00\x1b[31m", "\\u0000\\u001b[31m"),
        ("\ud800", "\\ud800"),
        ("\U000e0001", "\\U000e0001"),
        ("two\nlines\tand a tab", "two\nlines\tand a tab"),
        ("\u2028\r", "\\u2028\\u000d"),
    ],
)
def test_what_cannot_be_seen_is_written_out(text, seen):
    assert visible(text) == seen
    html(text).encode()


def test_a_long_text_is_cut():
    assert visible("abcdef", 6) == "abcdef"
    assert visible("abcdefg", 6) == "abcde…"


def test_a_table_aligns_numbers():
    made = table(("name", "value"), [("<a>", 1), ("b", None)], (0,))
    assert '<td>&lt;a&gt;</td><td class="number">1</td>' in made
    assert '<td>b</td><td class="number"></td>' in made
    assert made.count("<tr>") == 3


def test_facts_leave_out_what_is_not_there():
    assert facts([("a", None), ("b", ""), ("c", 0)]) == ("<dl><div><dt>c</dt><dd>0</dd></div></dl>")
