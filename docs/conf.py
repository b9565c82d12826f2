"""Configuration of the documentation: ``sphinx-build -W -b html docs docs/_build/html``."""

from __future__ import annotations

import sys
from pathlib import Path

from desim_uav import __version__

sys.path.insert(0, str(Path(__file__).parent / "_ext"))

project = "desim-uav"
author = "The desim-uav authors"
copyright = "The desim-uav authors, MIT licence"  # noqa: A001
version = release = __version__

extensions = ["myst_nb", "sphinx.ext.autodoc", "docstrings", "generated", "mathml"]
exclude_patterns = ["_build", "_generated", "**.ipynb_checkpoints"]

html_theme = "furo"
html_static_path = ["_static"]
html_css_files = ["wide.css"]
html_js_files = ["sort.js"]
html_math_renderer = "mathml"
html_title = f"desim-uav {__version__}"

myst_enable_extensions = ["amsmath", "deflist", "dollarmath"]
myst_heading_anchors = 4

nb_execution_mode = "cache"
nb_execution_in_temp = True
nb_execution_raise_on_error = True
nb_execution_timeout = 600
nb_merge_streams = True

autodoc_member_order = "bysource"
autodoc_typehints = "signature"
autodoc_type_aliases = {"NDArray": "NDArray"}
# An extra's packages need not be installed for the documentation of what uses them.
autodoc_mock_imports = [
    *("benchmarl", "ray", "sb3_contrib", "stable_baselines3", "tensorboard", "tensordict"),
    *("torch", "torchrl"),
]
