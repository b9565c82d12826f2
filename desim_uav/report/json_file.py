"""Reads the JSON files of a run folder, which may come from anyone and are therefore checked."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from pydantic import BaseModel, ConfigDict, ValidationError

from desim_uav.checksums import verify
from desim_uav.errors import PolicyError
from desim_uav.rowcode.regular_file import text_of
from desim_uav.scenario.messages import message_of

MOST_BYTES = 2**28
"""The largest JSON file of a run folder that is read; a world of a million users has 60 MB."""


_WORDS = {"missing": "missing"} | dict.fromkeys(("model_type", "dict_type"), "must be an object")
"""What is wrong, by the kind of error, where files of JSON have other words than scenarios."""


class Form(BaseModel):
    """The least content of a file, with the type of each value."""

    model_config = ConfigDict(strict=True, frozen=True)


def read_json(file: Path, form: type[Form], what: str) -> dict[str, Any]:
    """Return the whole content of a file.

    Raises PolicyError, with the file and the key, if the content does not have the given form or
    the file has changed since it was written. ``what`` names the content in the message, such as
    "the world of a run".
    """
    try:
        verify(file)
        content = json.loads(text_of(file, MOST_BYTES))
    except (OSError, ValueError, RecursionError) as error:
        reason = getattr(error, "strerror", None) or error
        raise PolicyError(f"{file}: not a readable JSON file: {reason}") from error
    try:
        form.model_validate(content)
    except ValidationError as error:
        first = error.errors(include_url=False)[0]
        where = "".join(f"{part}: " for part in (".".join(map(str, first["loc"])),) if part)
        problem = _WORDS.get(first["type"]) or message_of(first)
        raise PolicyError(f"{file}: not {what}: {where}{problem}") from error
    return dict(content)
