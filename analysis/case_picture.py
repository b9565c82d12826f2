"""Draw the map of a run: python analysis/case_picture.py RUN_DIR PICTURE.png [EPISODE [MINUTE]]."""

import sys
from pathlib import Path

from desim_uav.report.figures import case_picture, to_bytes

run_dir, picture, *when = sys.argv[1:]
figure = case_picture(Path(run_dir), *map(int, when))
Path(picture).write_bytes(to_bytes(figure, Path(picture).suffix.lower()))
