"""The interface of processing, by which a processor divides its cycles among tasks.

The built-in components are in ``rules.processing``.
"""

from __future__ import annotations

from typing import Any, ClassVar


class RowProcessing:
    """A way to compute tasks over rows, which can be compiled, so that both engines run it.

    A subclass is a frozen dataclass whose fields are numbers, or mappings from services to numbers.
    Tasks stand in line in the order of their arrival or, ``by_deadline``, in that of their
    deadlines.
    """

    by_deadline: ClassVar[bool] = False
    plain: ClassVar = ()

    def process(self, world: Any, state: Any, drone: Any, phase: int) -> None:
        """Divide the processor among the users in ``drone.computing``, of whom there is one.

        ``rules.service.give_rate`` gives a user's task a rate in thousandths of a cycle per
        microsecond, and a bandwidth of 0; a rate of 0 lets it wait. Call it for each. A core has
        the rate ``clock`` of ``world.processors[drone.radio]``, and must not be given to two tasks.
        """
        raise NotImplementedError
