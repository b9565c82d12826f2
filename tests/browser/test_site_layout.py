"""The script that finds the pages of the site that scroll sideways."""

from __future__ import annotations

import shutil
from pathlib import Path

import pytest

from analysis.site_layout import too_wide


@pytest.mark.thorough
@pytest.mark.skipif(not shutil.which("chromium"), reason="there is no chromium")
def test_a_page_that_scrolls_sideways_is_found_with_what_sticks_out(tmp_path: Path) -> None:
    scrolling = 'style="overflow-x:auto"'
    pages = {
        "wide": '<div class="content"><p style="width:700px">A wide one.</p>',
        "own": f'<div class="content" {scrolling}><p style="width:700px">Wide.</p></div>',
        "fits": f'<div {scrolling}><p style="width:3000px">It scrolls by itself.</p>',
    }
    for name, body in pages.items():
        text = f'<!doctype html><meta charset="utf-8"><body style="margin:0">{body}'
        (tmp_path / f"{name}.html").write_text(text, encoding="utf-8")
    assert too_wide(tmp_path, timeout_s=60) == [
        ("own.html", 360, 340, ["p.: Wide."]),
        ("wide.html", 360, 340, ["p.: A wide one."]),
    ]


def test_a_folder_without_pages_is_refused(tmp_path: Path) -> None:
    with pytest.raises(FileNotFoundError, match=r"no pages in|no chromium"):
        too_wide(tmp_path)
