"""The base of all mappings of a scenario file."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Annotated, Any, ClassVar, NamedTuple, Self

from pydantic import BaseModel, ConfigDict, Field, GetJsonSchemaHandler
from pydantic.json_schema import JsonSchemaValue
from pydantic_core import CoreSchema

from desim_uav.scenario.meanings import with_meanings

Fraction = Annotated[float, Field(ge=0, le=1)]


class Forms(NamedTuple):
    """Beside a union of sections: which of them has the keys of a mapping."""

    of: Callable[[Mapping[str, Any]], type[Section]]


class Section(BaseModel):
    """A mapping of a scenario file: unknown keys are refused, values never change."""

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)

    later: ClassVar[tuple[str, ...]] = ()
    """The keys that came later: a scenario without them has the hash that it had before."""

    def _settle(self, **values: object) -> None:
        """Set what follows from other keys; ``model_fields_set`` still says what was given."""
        self.__dict__.update(values)

    def _with(self, **values: object) -> Self:
        """A copy in which some values follow from other keys."""
        copied = self.model_copy()
        copied._settle(**values)
        return copied

    @classmethod
    def __get_pydantic_json_schema__(
        cls, schema: CoreSchema, handler: GetJsonSchemaHandler
    ) -> JsonSchemaValue:
        """Return the JSON schema, in which each key has its description."""
        description = handler(schema)
        with_meanings(handler.resolve_ref_schema(description), cls)
        return description
