"""The mask of a drone in a mode, by the rules, without a world."""

from __future__ import annotations

from desim_uav.model.rules import Choice, Mode, share_of
from desim_uav.rules.decide import chooses_share, is_allowed


def mask(
    actions: tuple[Choice, ...], mode: Mode, may_return: bool, may_charge: bool
) -> tuple[bool, ...]:
    """Return the mask of a drone in this mode: one entry per action."""
    most = max(share_of(each, 0.0) for each in actions)
    return tuple(
        is_allowed(int(each), int(mode), may_return, may_charge)
        and chooses_share(int(mode), share_of(each, most), most)
        for each in actions
    )
