"""Components in a scenario: ``{kind: …, parameters}`` becomes an instance, and the reverse."""

from __future__ import annotations

import dataclasses
import inspect
import os
import typing
from collections.abc import Mapping
from functools import cache
from pathlib import Path
from typing import Any

from pydantic import ConfigDict, GetCoreSchemaHandler, GetJsonSchemaHandler, TypeAdapter
from pydantic import ValidationError as PydanticError
from pydantic.json_schema import JsonSchemaValue
from pydantic_core import CoreSchema, InitErrorDetails, PydanticCustomError, core_schema, to_json

from desim_uav import registry
from desim_uav.errors import did_you_mean
from desim_uav.registry import FAULTS, what_failed
from desim_uav.scenario.conformance import answering, attributes, is_interface, lacks
from desim_uav.scenario.description import GIVEN, described
from desim_uav.scenario.meanings import with_meanings
from desim_uav.scenario.yaml12 import KeyPath

LARGEST = 1e9
"""The largest value of a parameter. Times in microseconds then fit into 64-bit integers."""


@dataclasses.dataclass(frozen=True)
class Slot:
    """Marks a field of the schema that holds a component: its slot, default kind and Protocol.

    A union of Protocols stands for any of them, and a base class for its subclasses.
    """

    name: str
    default: str
    protocol: Any
    by_name: bool = False
    """Whether the name of a kind alone stands for a component without parameters."""

    def __get_pydantic_core_schema__(
        self, source: object, handler: GetCoreSchemaHandler
    ) -> CoreSchema:
        """Make an instance during validation, and write it as ``described`` does."""
        return core_schema.with_info_plain_validator_function(
            self._validate,
            serialization=core_schema.plain_serializer_function_ser_schema(described),
        )

    def __get_pydantic_json_schema__(
        self, schema: CoreSchema, handler: GetJsonSchemaHandler
    ) -> JsonSchemaValue:
        """Return the schema of all built-in components and of a plug-in."""
        forms = [self._built_in_schema(kind) for kind in registry.names(self.name)]
        kinds = [{"enum": registry.names(self.name)}] if self.by_name else []
        return {"anyOf": [*forms, *kinds, _PLUG_IN_SCHEMA]}

    def component_class(self, kind: str) -> type:
        """Return the class of a kind, ready for validation. Raises ValueError."""
        try:
            class_ = registry.resolve(self.name, kind)
        except TypeError as error:
            raise ValueError(f"{kind!r} cannot be used as {self.name}: {error}") from error
        if not is_interface(self.protocol) and not issubclass(class_, self.protocol):
            base = f"{self.protocol.__module__}.{self.protocol.__qualname__}"
            raise ValueError(f"{kind!r} cannot be used as {self.name}: it is no subclass of {base}")
        missing = lacks(class_, self.protocol)
        if missing:
            raise ValueError(
                f"{kind!r} cannot be used as {self.name}: it has no method {missing[0]!r}"
            )
        for method in answering(class_):
            raise ValueError(
                f"{kind!r} cannot be used as {self.name}: its method {method!r} returns a value, "
                f"which nobody reads; it must write what it has worked out into its rows"
            )
        return class_

    def parameter_names(self, kind: Any) -> list[str]:
        """Return the keys that a component of this kind accepts."""
        try:
            return ["kind", *_parameters(self.component_class(kind or self.default))]
        except (TypeError, ValueError):
            return ["kind"]

    def annotation(self, kind: Any, name: str) -> Any:
        """Return the annotation of a parameter of a component of this kind, or None."""
        try:
            class_ = self.component_class(kind or self.default)
            return typing.get_type_hints(class_, include_extras=True).get(name)
        except (NameError, TypeError, ValueError):
            return None

    def _validate(self, value: object, info: core_schema.ValidationInfo) -> Any:
        if self.by_name and isinstance(value, str):
            value = {"kind": value}
        if isinstance(value, Mapping):
            return self._make(dict(value), info.context or {})
        if info.mode == "python" and not lacks(value, self.protocol):
            return value
        hint = f"; write {{kind: {value}}}" if isinstance(value, str) else ""
        name = "the name of a kind, or " if self.by_name else ""
        raise _error(f"must be {name}a mapping with a kind{hint}")

    def _make(self, mapping: dict[str, Any], context: Mapping[str, Any]) -> Any:
        kind = mapping.pop("kind", self.default)
        if not isinstance(kind, str):
            raise _error_at("kind", "must be text: " + self._allowed(), kind)
        try:
            class_ = self.component_class(kind)
        except ValueError as error:
            raise _error_at("kind", str(error), kind) from error
        _refuse_huge(mapping)
        if not dataclasses.is_dataclass(class_):
            component = _called(class_, mapping)
        else:
            component = _validated(class_, mapping, context.get("base"))
        missing = [name for name in attributes(self.protocol) if not hasattr(component, name)]
        if missing:
            problem = f"{kind!r} cannot be used as {self.name}: it has no attribute {missing[0]!r}"
            raise _error_at("kind", problem, kind)
        return component

    def _allowed(self) -> str:
        return f'{", ".join(registry.names(self.name))}, or "package.module:Class"'

    def _built_in_schema(self, kind: str) -> JsonSchemaValue:
        class_ = registry.resolve(self.name, kind)
        schema = with_meanings(_whole(_adapter(class_).json_schema()), class_)
        schemas = {key: schema["properties"][key] for key in _parameters(class_)}
        properties = {"kind": {"const": kind}} | schemas
        for name, part in _parts(class_).items():
            properties[name]["default"] = described(part)
        required = schema.get("required", [])
        if kind != self.default:
            required = ["kind", *required]
        return schema | {
            "title": kind,
            "properties": properties,
            "required": required,
            "additionalProperties": False,
        }


def _whole(schema: JsonSchemaValue) -> JsonSchemaValue:
    """Return a schema with its definitions where they are referred to."""
    definitions = schema.get("$defs", {})

    def put_in(part: object) -> Any:
        if isinstance(part, list):
            return [put_in(one) for one in part]
        if not isinstance(part, dict):
            return part
        name = str(part.get("$ref", "")).removeprefix("#/$defs/")
        if name in definitions:
            return put_in(definitions[name])
        return {key: put_in(one) for key, one in part.items() if key != "$defs"}

    whole: JsonSchemaValue = put_in(schema)
    return whole


@dataclasses.dataclass(frozen=True)
class NameOrForm:
    """Validates a field that is one of some names, or a value of another form (a ``NameOr``)."""

    mark: registry.NameOr

    def __get_pydantic_core_schema__(
        self, source: object, handler: GetCoreSchemaHandler
    ) -> CoreSchema:
        """Return a validation whose problems are those of the form that was meant."""
        return core_schema.no_info_plain_validator_function(self._validate)

    def __get_pydantic_json_schema__(
        self, schema: CoreSchema, handler: GetJsonSchemaHandler
    ) -> JsonSchemaValue:
        """Return the schema of the names and of the other form."""
        names = [{"enum": list(self.mark.names)}] if self.mark.names else []
        return {"anyOf": [*names, self._form_schema()]}

    def _form_schema(self) -> JsonSchemaValue:
        """Return the schema of the other form; named tuples are mappings, as in scenarios."""
        form = self.mark.form
        if not self._is_list:
            return _keyed(form)
        listed: JsonSchemaValue = _whole(_adapter(form).json_schema())
        return listed | {"items": _keyed(typing.get_args(form.__origin__)[0])}

    @property
    def _is_list(self) -> bool:
        return not hasattr(self.mark.form, "_fields")

    def _validate(self, value: object) -> Any:
        names = self.mark.names
        if isinstance(value, str) and value in names:
            return value
        if not isinstance(value, list if self._is_list else Mapping):
            hint = did_you_mean(value, names) if isinstance(value, str) else ""
            allowed = " or ".join([*filter(None, [", ".join(names)]), self.mark.says])
            raise _error(f"must be {allowed}{hint}")
        items = value if self._is_list else []
        wrong = [(index, item) for index, item in enumerate(items) if not isinstance(item, Mapping)]
        if wrong:
            raise errors([((index,), "must be a mapping", item) for index, item in wrong])
        form = strictly(self.mark.form, value)
        try:
            return self.mark.made(form) if self.mark.made else form
        except ValueError as error:
            raise _error(str(error)) from error


def _keyed(form: Any) -> JsonSchemaValue:
    """Return the schema of a mapping with the fields of a named tuple."""
    hints = typing.get_type_hints(form, include_extras=True)
    schema = {
        "type": "object",
        "properties": {name: _adapter(hints[name]).json_schema() for name in form._fields},
        "required": [name for name in form._fields if name not in form._field_defaults],
        "additionalProperties": False,
    }
    return with_meanings(schema, form)


@dataclasses.dataclass(frozen=True)
class CheckedField:
    """Validates a field as its type says, and then by a check of its own (a ``Checked``)."""

    mark: registry.Checked

    def __get_pydantic_core_schema__(
        self, source: object, handler: GetCoreSchemaHandler
    ) -> CoreSchema:
        """Return a validation that tells the reason for which the check refuses a value."""

        def checked(value: object) -> Any:
            try:
                self.mark.check(value)
            except ValueError as error:
                raise _error(str(error)) from error
            return value

        return core_schema.no_info_after_validator_function(checked, handler(source))

    def __get_pydantic_json_schema__(
        self, schema: CoreSchema, handler: GetJsonSchemaHandler
    ) -> JsonSchemaValue:
        """Return the schema of the field's type."""
        return handler(schema)


def as_field(mark: registry.FieldMark) -> Slot | NameOrForm | CheckedField:
    """Return what validates a marked field of a component."""
    if isinstance(mark, registry.ComponentField):
        return Slot(mark.slot, mark.default, mark.protocol, mark.by_name)
    if isinstance(mark, registry.Checked):
        return CheckedField(mark)
    assert isinstance(mark, registry.NameOr)
    return NameOrForm(mark)


registry.FieldMark.as_field = staticmethod(as_field)

_PLUG_IN_SCHEMA: JsonSchemaValue = {
    "title": "plug-in",
    "description": "A class of your own; importing it runs its code.",
    "type": "object",
    "properties": {"kind": {"type": "string", "pattern": r"^[\w.]+:\w+$"}},
    "required": ["kind"],
}


def place_of_problem(component: object) -> KeyPath:
    """Return the key at which a component's problem is reported: its file, if it has just one."""
    names = _file_parameters(type(component))  # type: ignore[arg-type]
    return (names[0],) if len(names) == 1 else ()


def strictly(kind: object, value: object, context: Mapping[str, Any] | None = None) -> Any:
    """Validate plain data strictly: lists may be tuples, but text and booleans are not numbers."""
    return _adapter(kind).validate_json(to_json(value), strict=True, context=context)


def errors(problems: list[tuple[KeyPath, str, Any]]) -> PydanticError:
    """Return an error for a validator to raise, with a (path, message, value) for each problem."""
    details: list[InitErrorDetails] = [
        {"type": _error(message), "loc": path, "input": value} for path, message, value in problems
    ]
    return PydanticError.from_exception_data("component", details)


def _validated(class_: type, arguments: dict[str, Any], base: Path | None) -> Any:
    """Return an instance of a dataclass; its file names are relative to ``base``."""
    try:
        files = _file_parameters(class_)
        for name in files:
            if isinstance(arguments.get(name), str):
                arguments[name] = os.path.abspath((base or Path()) / arguments[name])  # noqa: PTH100
        return strictly(class_, arguments, {"base": base})
    except PydanticError as error:
        causes = [e["ctx"]["error"] for e in error.errors() if not e["loc"] and "ctx" in e]
        if causes and len(files) == 1:
            raise _error_at(files[0], str(causes[0]), arguments.get(files[0])) from error
        raise
    except FAULTS as error:
        raise _error(f"cannot be made: {what_failed(error)}") from error


def _called(class_: type, arguments: dict[str, Any]) -> Any:
    """Return an instance of a user's class that is not a dataclass."""
    try:
        component = class_(**arguments)
    except FAULTS as error:
        raise _error(f"cannot be made: {what_failed(error)}") from error
    try:
        object.__setattr__(component, GIVEN, arguments)
    except AttributeError as error:
        raise _error(f"{class_.__name__} must be a dataclass, or have no __slots__") from error
    return component


def _refuse_huge(arguments: Mapping[str, Any]) -> None:
    problems = []
    pending: list[tuple[KeyPath, Any]] = [((), arguments)]
    while pending:
        path, value = pending.pop()
        if isinstance(value, Mapping):
            pending += [((*path, key), item) for key, item in value.items()]
        elif isinstance(value, list):
            pending += [((*path, index), item) for index, item in enumerate(value)]
        elif isinstance(value, int | float) and abs(value) > LARGEST:
            bound = f"at most {LARGEST:,.0f}" if value > 0 else f"at least {-LARGEST:,.0f}"
            problems.append((path, f"must be {bound}", value))
    if problems:
        raise errors(problems)


@cache
def _adapter(kind: Any) -> TypeAdapter[Any]:
    """Return the validator of a class. A dataclass refuses unknown parameters, as models do."""
    if dataclasses.is_dataclass(kind) and "__pydantic_config__" not in vars(kind):
        setattr(kind, "__pydantic_config__", ConfigDict(extra="forbid"))  # noqa: B010
    return TypeAdapter(kind)


def _parts(class_: type) -> dict[str, Any]:
    """Return the defaults of those fields of a dataclass that are components themselves."""
    hints = typing.get_type_hints(class_, include_extras=True)
    return {
        field.name: field.default_factory()
        for field in dataclasses.fields(class_)
        if field.default_factory is not dataclasses.MISSING
        and any(isinstance(mark, registry.ComponentField) for mark in _marks(hints[field.name]))
    }


def _marks(hint: object) -> tuple[Any, ...]:
    return getattr(hint, "__metadata__", ())


def _parameters(class_: type) -> list[str]:
    if dataclasses.is_dataclass(class_):
        return [f.name for f in dataclasses.fields(class_) if f.init]
    return [name for name in inspect.signature(class_).parameters if name not in ("args", "kwargs")]


@cache
def _file_parameters(class_: type) -> tuple[str, ...]:
    if not dataclasses.is_dataclass(class_):
        return ()
    hints = typing.get_type_hints(class_)
    paths: tuple[Any, ...] = (Path, Path | None)
    return tuple(f.name for f in dataclasses.fields(class_) if f.init and hints[f.name] in paths)


def _error(message: str) -> PydanticCustomError:
    return PydanticCustomError("component", "{message}", {"message": message})


def _error_at(key: str, message: str, value: object) -> PydanticError:
    return errors([((key,), message, value)])
