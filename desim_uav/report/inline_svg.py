"""A figure as inert SVG inside a page, with the page's colours and typeface."""

from __future__ import annotations

import re
import warnings
from collections.abc import Callable
from io import BytesIO
from typing import TYPE_CHECKING
from xml.etree import ElementTree

from desim_uav.report.figures.style import as_text, styled
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
"""The number of steps between the page's text colour (grey-0) and its background (grey-8)."""

LARGEST = 1_000_000
"""The size in bytes above which a figure becomes a PNG image."""

LONGEST = 80
"""The largest number of characters of a text in a figure."""


@styled
def drawn(draw: Callable[[], Figure], label: str, number: int) -> Html:
    """Return the figure that ``draw`` makes as an element of a page; ``label`` describes it.

    ``number`` is the figure's number in the page, which keeps its identifiers unique.
    """
    from matplotlib import rcParams

    rcParams.update({"svg.fonttype": "none", "svg.hashsalt": str(number)})
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # names may contain characters that the typeface lacks
        figure = draw()
        svg = _saved(figure, "svg")
        if len(svg) > LARGEST:
            return _points(figure, label)
    return _inert(as_text(svg), label, f"f{number}-")


def _saved(figure: Figure, form: str) -> bytes:
    file = BytesIO()
    dated = {"Date": None} if form == "svg" else None
    figure.savefig(file, format=form, dpi=160, metadata=dated, transparent=form == "svg")
    return file.getvalue()


def _points(figure: Figure, label: str) -> Html:
    """Return a figure as a PNG image."""
    from base64 import b64encode

    source = "data:image/png;base64," + b64encode(_saved(figure, "png")).decode()
    return tag("img", src=source, alt=label)


def _inert(svg: str, label: str, prefix: str) -> Html:
    """Return an SVG with known elements and attributes only, its identifiers with a prefix."""
    root = ElementTree.fromstring(svg)
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
    """Return whether a link stays within the page."""
    return link.startswith(("#", "data:image/png;base64,"))


def _named(attribute: str, value: str, prefix: str) -> str:
    if attribute == "id":
        return prefix + value
    if attribute == "href" and value.startswith("#"):
        return f"#{prefix}{value[1:]}"
    value = value.replace("url(#", f"url(#{prefix}")
    return re.sub("#([0-9a-f]{2})\\1\\1", _shade, value) if attribute in COLOURED else value


def _shade(grey: re.Match[str]) -> str:
    """Return a grey as a shade of the page."""
    return f"var(--grey-{round(int(grey[1], 16) / 255 * GREYS)})"
