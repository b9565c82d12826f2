"""What the parameters of the verbs may be: their bounds and names, each once.

The command line reads this and the signatures of the verbs before anything runs, so modules with
verbs import nothing that takes long: what a verb needs, it imports when it is called.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from typing import Annotated, Any, TypeVar

from desim_uav.typed import Label, OneOf, Within, typed

F = TypeVar("F", bound=Callable[..., Any])

MOST_EPISODES, MOST_TRAINING = 10**6, 10**7
MOST_SEEDS, LAST_SEED, LAST_FIRST_SEED = 10**6, 2**63 - 1, 2**62


def verb(function: F) -> F:
    """Let a verb check its arguments; the types of ``api.kinds`` are imported at the first call."""
    return typed(function, names_in="desim_uav.api.kinds")


def _engines() -> Iterable[str]:
    from desim_uav.engine.choose import CHOICES

    return CHOICES


ENGINES = OneOf(_engines)
EngineName = Annotated[str, ENGINES]
Seed = Annotated[int | None, Within(0, LAST_SEED)]
Seeds = Annotated[int, Within(1, MOST_SEEDS)]
FirstSeed = Annotated[int, Within(0, LAST_FIRST_SEED)]
Episodes = Annotated[int, Within(1, MOST_EPISODES)]
RunName = Annotated[str | None, Label(200)]
Warmup = Annotated[int, Within(0, MOST_EPISODES)]
TrainingEpisodes = Annotated[int, Within(1, MOST_TRAINING)]
Jobs = Annotated[int, Within(1, 1024)]
