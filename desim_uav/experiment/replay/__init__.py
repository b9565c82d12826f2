"""A page that plays one run or two: ``again`` plays runs again, ``side_by_side`` compares two.

``page`` calls both and makes the page.
"""

from desim_uav.experiment.replay.again import playable

__all__ = ["playable"]
