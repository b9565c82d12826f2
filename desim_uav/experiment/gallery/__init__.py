"""The work of ``desim-uav gallery``: what published papers print, beside what is computed here."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from desim_uav.errors import UsageError, did_you_mean
from desim_uav.experiment.gallery import (
    a3,
    al_hourani,
    andrews,
    class_rings,
    mozaffari_2015,
    mozaffari_2016,
    random_waypoint,
    tr_36777,
    wu_2018,
    zeng,
    zhang_2017,
)
from desim_uav.experiment.gallery.row import GalleryRow
from desim_uav.experiment.progress import progress

if TYPE_CHECKING:
    from matplotlib.figure import Figure

COLUMNS = ("figure", "where", "theirs", "ours", "apart", "limit", "holds")


@dataclass(frozen=True)
class Entry:
    """A paper: how it is cited, its rows, and its figure."""

    paper: str
    rows: Callable[[], Iterator[GalleryRow]]
    draw: Callable[[], Figure] | None = None


ENTRIES = {
    "al_hourani_2014": Entry(
        "Al-Hourani, Kandeepan, Lardner: Optimal LAP altitude for maximum coverage. IEEE Wireless "
        "Communications Letters 3(6), 2014",
        al_hourani.rows,
        al_hourani.draw,
    ),
    "class_rings": Entry(
        "Rings of classes, from the path loss of Al-Hourani, Kandeepan, Lardner 2014",
        class_rings.rows,
        class_rings.draw,
    ),
    "mozaffari_2015": Entry(
        "Mozaffari, Saad, Bennis, Debbah: Drone small cells in the clouds: design, deployment and "
        "performance analysis. IEEE GLOBECOM 2015",
        mozaffari_2015.rows,
        mozaffari_2015.draw,
    ),
    "mozaffari_2016": Entry(
        "Mozaffari, Saad, Bennis, Debbah: Efficient deployment of multiple unmanned aerial "
        "vehicles for optimal wireless coverage. IEEE Communications Letters 20(8), 2016",
        mozaffari_2016.rows,
        mozaffari_2016.draw,
    ),
    "andrews_2011": Entry(
        "Andrews, Baccelli, Ganti: A tractable approach to coverage and rate in cellular networks. "
        "IEEE Transactions on Communications 59(11), 2011",
        andrews.rows,
        andrews.draw,
    ),
    "event_a3": Entry("3GPP TS 38.331: event A3, with a loss that follows a power law", a3.rows),
    "tr_36777": Entry(
        "3GPP TR 36.777 V15.0.0: Enhanced LTE support for aerial vehicles, annex B",
        tr_36777.rows,
        tr_36777.draw,
    ),
    "yoon_2003": Entry(
        "Yoon, Liu, Noble: Random waypoint considered harmful. IEEE INFOCOM 2003",
        random_waypoint.decay_rows,
        random_waypoint.draw,
    ),
    "navidi_camp_2004": Entry(
        "Navidi, Camp: Stationary distributions for the random waypoint mobility model. IEEE "
        "Transactions on Mobile Computing 3(1), 2004",
        random_waypoint.cure_rows,
    ),
    "zeng_2019": Entry(
        "Zeng, Xu, Zhang: Energy minimization for wireless communication with rotary-wing UAV. "
        "IEEE Transactions on Wireless Communications 18(4), 2019",
        zeng.rows,
        zeng.draw,
    ),
    "zeng_2017": Entry(
        "Zeng, Zhang: Energy-efficient UAV communication with trajectory optimization. IEEE "
        "Transactions on Wireless Communications 16(6), 2017",
        zeng.wing_rows,
    ),
    "wu_2018": Entry(
        "Wu, Zeng, Zhang: Joint trajectory and communication design for multi-UAV enabled wireless "
        "networks. IEEE Transactions on Wireless Communications 17(3), 2018",
        wu_2018.rows,
        wu_2018.draw,
    ),
    "zhang_2017": Entry(
        "Zhang, Zeng, Zhang: Cellular-enabled UAV communication: trajectory optimization under "
        "connectivity constraint. IEEE ICC 2018, arXiv 1710.11619",
        zhang_2017.rows,
        zhang_2017.draw,
    ),
}
"""The papers, by the names that the command takes."""


@dataclass(frozen=True)
class Compared:
    """A paper with its rows computed."""

    name: str
    paper: str
    rows: tuple[GalleryRow, ...]

    def content(self) -> dict[str, Any]:
        """Return it as plain values."""
        rows = [row.content() for row in self.rows]
        return {"name": self.name, "paper": self.paper, "rows": rows}


def gallery(names: Sequence[str] = (), show_progress: bool = False) -> list[Compared]:
    """Compute the figures of papers: those named, or all. Raises UsageError for unknown names."""
    for name in names:
        if name not in ENTRIES:
            hint = did_you_mean(name, ENTRIES)
            raise UsageError(f"no such paper: {name!r}{hint}; there are {', '.join(ENTRIES)}")
    papers = list(dict.fromkeys(names)) or list(ENTRIES)
    compared = []
    with progress(show_progress, len(papers), "papers") as advance:
        for name in papers:
            compared.append(Compared(name, ENTRIES[name].paper, tuple(ENTRIES[name].rows())))
            advance()
    return compared


def count(compared: Sequence[Compared]) -> dict[str, int]:
    """Return how many rows hold, how many do not, and how many are open."""
    verdicts = [row.holds for one in compared for row in one.rows]
    return {
        "hold": verdicts.count(True),
        "fail": verdicts.count(False),
        "open": verdicts.count(None),
    }


def summary(compared: Sequence[Compared]) -> str:
    """Return in one line how many figures hold."""
    counted = count(compared)
    claimed = counted["hold"] + counted["fail"]
    return f"{counted['hold']} of {claimed} figures hold, {counted['open']} are open"


def tables(compared: Sequence[Compared]) -> list[tuple[str, list[Any]]]:
    """Return the title and the rows of each paper's table."""
    return [(f"{one.name}. {one.paper}", [row.cells() for row in one.rows]) for one in compared]


def without_figure(compared: Sequence[Compared]) -> list[str]:
    """Return the names of the papers for which no figure is drawn."""
    return [one.name for one in compared if ENTRIES[one.name].draw is None]


def draw_all(compared: Sequence[Compared], folder: Path) -> list[Path]:
    """Draw the papers that have a figure, each into a PNG in a folder, and return the files."""
    from desim_uav.disk import file_place, write_at
    from desim_uav.report.figures.style import to_bytes

    written = []
    for one in compared:
        draw = ENTRIES[one.name].draw
        if draw is not None:
            place = folder / f"{one.name}.png"
            write_at(file_place(place, "--figure"), to_bytes(draw(), ".png"))
            written.append(place)
    return written
