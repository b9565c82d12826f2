"""The heights of buildings by their tags."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Mapping

LEVEL_M = 3.2
"""The height of a storey."""

TALLEST_M = 1000.0
"""No building is taller; a tag that says so is not understood."""

BY_TYPE_M: Mapping[str, float] = {
    **dict.fromkeys(("garage", "garages", "carport", "shed", "hut", "kiosk", "greenhouse"), 3.0),
    **dict.fromkeys(("house", "detached", "semidetached_house", "bungalow", "farm"), 6.4),
    **dict.fromkeys(("terrace", "residential", "school", "kindergarten", "retail"), 9.6),
    **dict.fromkeys(("apartments", "dormitory", "office", "hospital", "hotel"), 16.0),
    **dict.fromkeys(("warehouse", "industrial", "barn", "hangar", "supermarket"), 8.0),
    **dict.fromkeys(("church", "cathedral", "mosque", "temple"), 20.0),
}
"""Heights of types of buildings (the value of the tag ``building``) without a height or levels."""

_METRES = re.compile(r"(\d+(?:[.,]\d+)?)\s*(?:m|metres?|meters?)?")
_FEET = re.compile(r"""(\d+(?:\.\d+)?)\s*(?:'|ft|feet)\s*(?:(\d+(?:\.\d+)?)\s*(?:"|''|in))?""")


def metres(text: str) -> float | None:
    """Return a height in metres as OpenStreetMap writes it, such as ``12 m`` or ``39'4"``.

    It is None if the text is no height above 0 and up to ``TALLEST_M``.
    """
    text = text.strip()
    if match := _METRES.fullmatch(text):
        height_m = float(match[1].replace(",", "."))
    elif match := _FEET.fullmatch(text):
        height_m = 0.3048 * float(match[1]) + 0.0254 * float(match[2] or 0.0)
    else:
        return None
    return height_m if 0.0 < height_m <= TALLEST_M else None


class Heights:
    """Takes heights from tags, and counts from which."""

    def __init__(self, other_m: float) -> None:
        """Take ``other_m`` where the tags say nothing."""
        self.other_m = other_m
        self.count: Counter[str] = Counter()
        self.first = ""

    def of(self, name: str, tags: Mapping[str, str]) -> float:
        """Return the height of a building: by its height, its levels, its type, or ``other_m``."""
        if metres(tags.get("min_height", "0")):
            self.count["min"] += 1
        levels = metres(tags.get("building:levels", ""))
        height_m = metres(tags.get("height", ""))
        if height_m is None and ("height" in tags or ("building:levels" in tags and not levels)):
            self.count["unclear"] += 1
            self.first = self.first or name
        if height_m is not None:
            return height_m
        if levels:
            return min(LEVEL_M * levels, TALLEST_M)
        by_type_m = BY_TYPE_M.get(tags.get("building", tags.get("building:part", "")))
        self.count["other" if by_type_m is None else "type"] += 1
        return self.other_m if by_type_m is None else by_type_m

    def notices(self) -> list[str]:
        """Return in words for how many buildings a height was assumed."""
        count, words = self.count, []
        if count["type"] or count["other"]:
            words.append(
                f"{count['type'] + count['other']} buildings have neither a height nor levels: "
                f"{count['type']} have that of their type and {count['other']} height_m, "
                f"{self.other_m:g} m"
            )
        if count["unclear"]:
            words.append(
                f"the height or the levels of {count['unclear']} buildings are not understood, "
                f"first of {self.first}"
            )
        if count["min"]:
            words.append(f"{count['min']} parts with a min_height stand on the ground, too")
        return words
