"""Parses XML that others made.

Document types and entities are refused, so a file can neither name another one nor grow while it is
read.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from xml.parsers import expat


class XmlReader:
    """Calls ``begin`` and ``end`` for each element of a file."""

    def __init__(self, file: Path) -> None:
        self.file = file
        parser = self._parser = expat.ParserCreate()
        parser.StartDoctypeDeclHandler = self._refuse
        parser.EntityDeclHandler = self._refuse
        parser.StartElementHandler = self.begin
        parser.EndElementHandler = self.end
        parser.CommentHandler = self.comment

    def parse(self, content: bytes) -> None:
        """Read the whole file. Raises ValueError with the file and the line."""
        try:
            self._parser.Parse(content, True)
        except expat.ExpatError as error:
            why = expat.ErrorString(error.code)
            raise ValueError(
                f"{self.file}:{error.lineno}: it is not well-formed XML: {why}"
            ) from error

    def begin(self, tag: str, attributes: Mapping[str, str]) -> None:
        """Begin an element."""

    def end(self, tag: str) -> None:
        """End an element."""

    def comment(self, text: str) -> None:
        """Read a comment."""

    @property
    def line(self) -> int:
        """The line of the file that is read."""
        return int(self._parser.CurrentLineNumber)

    def text(self, tag: str, attributes: Mapping[str, str], name: str) -> str:
        """Return an attribute. Raises ValueError if the element does not have it."""
        if name not in attributes:
            raise self.error(f"<{tag}> has no attribute {name!r}")
        return attributes[name]

    def error(self, problem: str) -> ValueError:
        """Return an error that names the file and the line."""
        return ValueError(f"{self.file}:{self.line}: {problem}")

    def _refuse(self, *_: object) -> None:
        raise self.error("a document type or entity is not allowed")
