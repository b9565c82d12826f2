"""The replay as a notebook shows it: a page within the page, in a frame without an address."""

import pytest

import desim_uav as du

pytestmark = pytest.mark.thorough

MOVED = """
const done = arguments[0];
replay.ready.then(() => {
  document.querySelector("canvas").focus();
  document.dispatchEvent(new KeyboardEvent("keydown", { key: "ArrowRight", bubbles: true }));
  setTimeout(() => done(replay.episodes), 1000);
});
"""


def test_it_plays_in_a_frame(chromium, tmp_path):
    page = du.run("tiny", events=True, progress=False).replay()
    file = tmp_path / "notebook.html"
    file.write_text(f"<!DOCTYPE html><body>{page._repr_html_()}", encoding="utf-8")
    chromium.get("about:blank")
    chromium.get_log("browser")
    chromium.get(file.as_uri())
    chromium.switch_to.frame(0)
    try:
        assert chromium.execute_async_script(MOVED) == [0]
    finally:
        chromium.switch_to.default_content()
    assert [entry["message"] for entry in chromium.get_log("browser")] == []
