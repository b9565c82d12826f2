"""Pages about runs, and those that play runs, as Python and a notebook have them."""

from __future__ import annotations

import tempfile
import webbrowser
from pathlib import Path
from typing import Any

from desim_uav.disk import file_place, write_at
from desim_uav.experiment.replay.page import ReplayPage, Written
from desim_uav.report.markup import tag
from desim_uav.typed import typed

HEIGHT_PX = 720


class Page:
    """A page in HTML, which a notebook shows; it needs no network and no server."""

    def __init__(self, content: bytes, name: str) -> None:
        self._content = content
        self._name = name

    @property
    def html(self) -> str:
        """The page itself."""
        return self._content.decode()

    @typed
    def save(self, file: str | Path) -> Path:
        """Write the page as HTML, in new folders if need be. Raises UsageError where that fails."""
        write_at(file_place(Path(file), endings=[".html"]), self._content)
        return Path(file)

    def open(self) -> Path:
        """Show the page in the browser; return the temporary file that it is in."""
        folder = Path(tempfile.mkdtemp(prefix="desim-uav-"))
        file = self.save(folder / self._name)
        webbrowser.open(file.as_uri())
        return file

    def __repr__(self) -> str:
        return f"<Page of {len(self._content):,} bytes>"

    def _repr_html_(self) -> str:
        style = f"width: 100%; height: {HEIGHT_PX}px; border: 0"
        frame = tag("iframe", srcdoc="\0", sandbox="allow-scripts", style=style)
        return frame.replace("\\u0000", self.html.replace("&", "&amp;").replace('"', "&quot;"))


class Replay(Page):
    """A page that plays a run's episodes in continuous time; it needs no network and no server."""

    def __init__(self, page: ReplayPage) -> None:
        super().__init__(page.content, "replay.html")
        self._page = page

    @property
    def episodes(self) -> list[int]:
        """The episodes that it shows."""
        return self._page.episodes

    @property
    def left_out(self) -> list[int]:
        """The episodes for which there was no room."""
        return self._page.left_out

    @property
    def file(self) -> Path | None:
        """The file that ``write_replay`` has written; None if it was not written so."""
        return self._page.file if isinstance(self._page, Written) else None

    def summary(self) -> dict[str, Any]:
        """Return what the page shows, and its file and size, as plain data."""
        return self._page.summary()

    def __repr__(self) -> str:
        return f"<Replay of {len(self.episodes)} episode(s), {len(self._content):,} bytes>"
