"""Figures inside a page: of known parts alone, whatever their texts say."""

import re
from xml.etree import ElementTree

import pytest
from matplotlib.figure import Figure

from desim_uav.report import inline_svg
from desim_uav.report.inline_svg import ATTRIBUTES, ELEMENTS, drawn

HOSTILE = (
    r"$\frac$",
    "$",
    "</svg><script>alert(1)</script>",
    '"><img src=x onerror=alert(1)>',
    "\x00\x08",
    "\u202e",
    "漢字",
    "x" * 5000,
)


def figure(text="text"):
    made = Figure(figsize=(4, 3), layout="constrained")
    axes = made.add_subplot(title=text, xlabel=text)
    axes.bar([0, 1], [1, 2], label=text, color="0.5", hatch="//", edgecolor="white")
    axes.axhline(1, color="black")
    axes.imshow([[0.0, 1.0]], extent=(0, 1, 0, 1), cmap="Greys")
    axes.legend()
    return made


@pytest.mark.thorough
@pytest.mark.parametrize("text", HOSTILE)
def test_nothing_in_it_can_act(text):
    svg = drawn(lambda: figure(text), text, 0)
    root = ElementTree.fromstring(svg)
    for element in root.iter():
        assert element.tag in ELEMENTS
        assert set(element.attrib) <= ATTRIBUTES | {"role", "aria-label"}
        link = element.get("href", "#")
        assert link.startswith(("#", "data:image/png;base64,"))
    assert "<script" not in svg and "http" not in svg
    seen = [e.text for e in root.iter("text")]
    if text.isprintable() and len(text) < 100:
        assert seen.count(text) == 3


def test_what_it_names_is_its_own():
    first, second = (drawn(figure, "a", number) for number in (1, 2))
    names = [set(re.findall(r' id="([^"]+)"', svg)) for svg in (first, second)]
    assert names[0] and not names[0] & names[1]
    for svg, own in zip((first, second), names, strict=True):
        used = re.findall(r'href="#([^"]+)"', svg) + re.findall(r"url\(#([^)]+)\)", svg)
        assert used and set(used) <= own


def test_greys_are_shades_of_the_page():
    svg = drawn(figure, "a", 0)
    assert "var(--grey-0)" in svg and "var(--grey-4)" in svg
    assert not re.search(r"#([0-9a-f]{2})\1\1\b", svg)


def test_the_same_figure_is_the_same_text():
    assert drawn(figure, "a", 0) == drawn(figure, "a", 0)


def test_a_large_one_becomes_points(monkeypatch):
    monkeypatch.setattr(inline_svg, "LARGEST", 1000)
    assert drawn(figure, '"<', 0).startswith('<img src="data:image/png;base64,iVBOR')
    assert 'alt="&quot;&lt;"' in drawn(figure, '"<', 0)
