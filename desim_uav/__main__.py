"""``python -m desim_uav`` is ``desim-uav``."""

from desim_uav.cli import main

main()
