"""The interface of sharing, by which a drone divides bandwidth among requests that share it.

These ask for a volume, and take whatever rate they are given. The built-in components
are in ``rules.sharing``.
"""

from __future__ import annotations

from typing import Any, ClassVar


class RowSharing:
    """A way to divide bandwidth over rows, which can be compiled, so that both engines run it.

    A subclass is a frozen dataclass whose fields are numbers, or mappings from services to numbers.
    If it divides none (not ``divides``), requests for a volume hold fixed rates instead of sharing.
    """

    divides: ClassVar[bool] = True
    plain: ClassVar = ()

    def divide(self, world: Any, state: Any, drone: Any, phase: int) -> None:
        """Divide ``drone.free_hz`` among the users in ``drone.sharing``, of whom there is one.

        They are in order of (request time, user). ``rules.service.give_share`` gives a user a
        bandwidth in Hz and a rate in bit/s, both 0 for one who has to wait; call it for each. The
        bandwidths must not exceed ``drone.free_hz`` together. If the drone has a backhaul, this is
        called twice: rates are proposed first, and then given, reduced if their sum is too large.
        """
        raise NotImplementedError
