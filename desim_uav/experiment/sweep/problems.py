"""All problems of a sweep's scenarios and policies, with the combinations that have them."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager

from desim_uav.errors import DesimError, PolicyError, ScenarioError
from desim_uav.experiment.sweep.grid import Combination

MOST_PROBLEMS = 100
"""The largest number of problems that are listed."""


class Problems:
    """Collects the problems of combinations, each once."""

    def __init__(self) -> None:
        self.combinations: list[Combination] = []
        self._of: dict[type[DesimError], dict[str, list[Combination]]] = {
            ScenarioError: {},
            PolicyError: {},
        }

    @contextmanager
    def noted(self) -> Iterator[None]:
        """Note an error of the block as a problem of the latest combination."""
        try:
            yield
        except (ScenarioError, PolicyError) as error:
            for line in str(error).splitlines():
                where = self._of[type(error)].setdefault(line, [])
                where += self.combinations[-1:] if self.combinations[-1] not in where[-1:] else []

    def complain(self) -> None:
        """Raise the problems of scenarios, or else those of policies, if there are any."""
        for of_type, noted in self._of.items():
            lines = [self._line(problem, where) for problem, where in noted.items()]
            if len(lines) > MOST_PROBLEMS:
                lines[MOST_PROBLEMS:] = [f"and {len(lines) - MOST_PROBLEMS} more"]
            if lines:
                raise of_type(*lines) if of_type is ScenarioError else of_type("\n".join(lines))

    def _line(self, problem: str, where: Sequence[Combination]) -> str:
        """Return a problem with the settings that its combinations share, or with the first one."""
        shared = [text for text in where[0].varied if all(text in c.varied for c in where)]
        alike = [c for c in self.combinations if set(shared) <= set(c.varied)]
        if len(alike) == len(where):
            return f"{problem} (with {', '.join(shared)})" if shared else problem
        return f"{problem} (with {where[0].name} and {len(where) - 1} more combination(s))"
