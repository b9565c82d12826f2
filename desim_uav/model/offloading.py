"""The interface of offloading, which decides what part of a task a drone computes for its user.

The built-in components are in ``rules.offloading``.
"""

from __future__ import annotations

from typing import Annotated, Any, ClassVar

from annotated_types import Ge, Le, MaxLen, MinLen

from desim_uav.model.rules import MOST_CHOICES, ascend
from desim_uav.registry import Checked

Shares = Annotated[
    tuple[Annotated[float, Ge(0), Le(1)], ...],
    MinLen(1),
    MaxLen(MOST_CHOICES),
    Checked(ascend),
]
"""Parts of tasks from which a command chooses, ascending."""


class RowOffloading:
    """A way to offload tasks over rows, which can be compiled, so that both engines run it.

    A subclass is a frozen dataclass whose fields are numbers, or mappings from services to numbers.
    If it has a field ``shares`` (of the type ``Shares``), each command of a drone chooses one.
    """

    plain: ClassVar = ()
    alone: ClassVar[bool] = True
    """Whether users may compute tasks, or parts of them, themselves, and so need a processor."""

    def share(self, world: Any, state: Any, user: Any) -> float:
        """Return the part of a user's task that is offloaded, from 0 to 1.

        It is asked when the request is made and, as long as nothing of it has begun, whenever the
        user is attached to a drone (``state.senders[user.holder]``; -1: to none). The user's own
        processor does ``world.clocks[user.index]`` thousandths of a cycle per microsecond.
        """
        raise NotImplementedError


def shares_of(offloading: RowOffloading) -> tuple[float, ...]:
    """Return the shares that a command can choose, ascending; none if it has no choice."""
    return tuple(getattr(offloading, "shares", ()))
