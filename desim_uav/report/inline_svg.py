"""A figure as SVG inside a page: it takes the page's colours and typeface and can do nothing."""

from __future__ import annotations

import re
import warnings
from collections.abc import Callable
from io import BytesIO
from typing import TYPE_CHECKING
from xml.etree import ElementTree

from desim_uav.report.figures.style import styled
from desim_uav.report.markup import Html, tag, visible

if TYPE_CHECKING:
    from matplotlib.figure import Figure

ELEMENTS = frozenset(
    (
        *("svg", "g", "defs", "path", "use", "rect", "circle", "clipPath", "pattern"),
        *("text", "tspan", "image"),
    )
)
COLOURED = frozenset(("style", "fill", "stroke"))
ATTRIBUTES = COLOURED | frozenset(
    (
        *("id", "d", "class", "transform", "clip-path", "x", "y", "width", "height", "viewBox"),
        *("href", "points", "r", "cx", "cy", "dx", "dy", "preserveAspectRatio", "stroke-width"),
        *("patternUnits", "patternTransform", "opacity", "fill-opacity", "stroke-opacity"),
    )
)
GREYS = 8
"""Shades between the page's ink (grey-0) and its paper (grey-8)."""

LARGEST = 1_000_000
"""Bytes; what is larger becomes a picture of points."""

LONGEST = 80
"""Letters of a text in a figure."""

NO_XML = re.compile("[^\t\n\r\u0020-\ud7ff\ue000-\ufffd\U00010000-\U0010ffff]")


@styled
def drawn(draw: Callable[[], Figure], label: str, number: int) -> Html:
    """What ``draw`` draws, as an element of a page; ``label`` says what it shows.

    ``number``: the figure's own in this page, which keeps its names apart from the others'.
    """
    from matplotlib import rcParams

    rcParams.update({"svg.fonttype": "none", "svg.hashsalt": str(number)})
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # names may hold letters that the typeface lacks
        figure = draw()
        svg = _saved(figure, "svg")
        if len(svg) > LARGEST:
            return _points(figure, label)
    return _inert(svg.decode(), label, f"f{number}-")


def _saved(figure: Figure, form: str) -> bytes:
    file = BytesIO()
    dated = {"Date": None} if form == "svg" else None
    figure.savefig(file, format=form, dpi=160, metadata=dated, transparent=form == "svg")
    return file.getvalue()


def _points(figure: Figure, label: str) -> Html:
    """A picture of points."""
    from base64 import b64encode

    source = "data:image/png;base64," + b64encode(_saved(figure, "png")).decode()
    return tag("img", src=source, alt=label)


def _inert(svg: str, label: str, prefix: str) -> Html:
    """An SVG of known elements and attributes alone, its names under a prefix of their own."""
    root = ElementTree.fromstring(NO_XML.sub("\ufffd", svg))
    _clean(root, prefix)
    del root.attrib["width"], root.attrib["height"]
    root.set("role", "img")
    root.set("aria-label", visible(label, LONGEST))
    return Html(ElementTree.tostring(root, encoding="unicode"))


def _clean(element: ElementTree.Element, prefix: str) -> None:
    element.tag = _local(element.tag)
    attributes = {_local(name): value for name, value in element.attrib.items()}
    element.attrib.clear()
    for name, value in attributes.items():
        if name in ATTRIBUTES and (name != "href" or _own(value)):
            element.set(name, _named(name, value, prefix))
    if element.text is not None:
        element.text = visible(element.text, LONGEST)
    for child in list(element):
        if _local(child.tag) in ELEMENTS:
            _clean(child, prefix)
        else:
            element.remove(child)


def _local(name: str) -> str:
    return name.rpartition("}")[2]


def _own(link: str) -> bool:
    """Does a link stay in the page?"""
    return link.startswith(("#", "data:image/png;base64,"))


def _named(attribute: str, value: str, prefix: str) -> str:
    if attribute == "id":
        return prefix + value
    if attribute == "href" and value.startswith("#"):
        return f"#{prefix}{value[1:]}"
    value = value.replace("url(#", f"url(#{prefix}")
    return re.sub("#([0-9a-f]{2})\\1\\1", _shade, value) if attribute in COLOURED else value


def _shade(grey: re.Match[str]) -> str:
    """A grey as a shade of the page."""
    return f"var(--grey-{round(int(grey[1], 16) / 255 * GREYS)})"
