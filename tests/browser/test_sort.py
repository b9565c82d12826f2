"""A click on a heading sorts the tables of the leaderboard."""

from pathlib import Path

import pytest

SCRIPT = Path(__file__).parents[2] / "docs" / "_static" / "sort.js"
ROWS = [("urban", "0.5"), ("edge", "-"), ("coverage", "<b>0.95</b>"), ("harvest", "-1.2")]
SHOWN = "return [...document.querySelectorAll('td:first-child')].map((cell) => cell.innerText)"


@pytest.mark.thorough
@pytest.mark.parametrize(
    ("folder", "clicks", "tasks"),
    [
        ("benchmark", [1], ["coverage", "urban", "harvest", "edge"]),
        ("benchmark", [1, 1], ["harvest", "urban", "coverage", "edge"]),
        ("benchmark", [1, 0], ["coverage", "edge", "harvest", "urban"]),
        ("other", [1], [task for task, _ in ROWS]),
    ],
)
def test_a_click_on_a_heading_sorts(chromium, tmp_path, folder, clicks, tasks):
    lines = "".join(f"<tr><td>{task}</td><td>{score}</td></tr>" for task, score in ROWS)
    heads = "<thead><tr><th>Task</th><th>Score</th></tr></thead>"
    page = tmp_path / folder / "overview.html"
    page.parent.mkdir()
    page.write_text(
        f"<script>{SCRIPT.read_text(encoding='utf-8')}</script><div class=content><table>{heads}"
        f"<tbody>{lines}</tbody></table></div>",
        encoding="utf-8",
    )
    chromium.get(page.as_uri())
    for column in clicks:
        chromium.execute_script(f"document.querySelectorAll('th')[{column}].click()")
    assert chromium.execute_script(SHOWN) == tasks
