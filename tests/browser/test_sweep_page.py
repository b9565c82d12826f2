"""The table of a sweep's report fits the page."""

import pytest

from desim_uav.experiment.sweep.pictures import sweep_report
from tests.experiment.test_sweep_pictures import COUNTS, RADII, make_sweep

FOUR = (COUNTS, RADII, "episode.steps=3,4", "users.mobility.speed_mps=1.4,2.8")
WIDTHS = """
const boxes = [...document.querySelectorAll(".scroll, .tall")];
return boxes.map((box) => box.scrollWidth - box.clientWidth);
"""


@pytest.mark.thorough
def test_a_table_of_four_keys_does_not_scroll_sideways(chromium, tmp_path):
    file = tmp_path / "report.html"
    file.write_text(sweep_report(make_sweep(tmp_path / "s", FOUR), None), encoding="utf-8")
    metrics = {"width": 1280, "height": 900, "deviceScaleFactor": 1, "mobile": False}
    chromium.execute_cdp_cmd("Emulation.setDeviceMetricsOverride", metrics)
    chromium.get(file.as_uri())
    beyond = chromium.execute_script(WIDTHS)
    assert beyond and max(beyond) == 0
