"""Draw the map of a run: python analysis/case_picture.py RUN_DIR PICTURE.png [EPISODE [MINUTE]]."""

import sys
from pathlib import Path

from desim_uav.report.figures import case_picture

run_dir, picture, *when = sys.argv[1:]
case_picture(Path(run_dir), *map(int, when)).savefig(picture, dpi=110)
