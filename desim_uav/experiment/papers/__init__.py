"""Published experiments: how each is cited, its figures, and what computes them here."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING

from desim_uav.experiment.papers import (
    a3,
    age_queues,
    al_hourani,
    andrews,
    bayerlein_2021,
    brunori,
    class_rings,
    do_2026,
    mozaffari_2015,
    mozaffari_2016,
    random_waypoint,
    tr_36777,
    wang_2021,
    wu_2018,
    zeng,
    zhang_2017,
)
from desim_uav.experiment.papers.harvest import SCENARIO
from desim_uav.experiment.papers.row import FigureRow

if TYPE_CHECKING:
    from matplotlib.figure import Figure


@dataclass(frozen=True)
class Entry:
    """A paper: how it is cited, its rows, its figure, and what is compared with it."""

    paper: str
    rows: Callable[[], Iterator[FigureRow]]
    draw: Callable[[], Figure] | None = None
    compared: str = ""
    doi: str | None = None
    scenarios: tuple[str, ...] = ()
    """The files beside these modules that describe the scenarios."""
    kept: str = ""
    """The folder where what has been computed stays after an interruption."""


ENTRIES = {
    "brunori_2021": Entry(
        "Brunori, Colonnese, Cuomo, Iocchi: A reinforcement learning environment for multi-service "
        "UAV-enabled wireless systems. IEEE PerCom Workshops 2021",
        brunori.rows,
        brunori.draw,
        compared="QoE3 of three policies in nine cases",
        doi="10.48550/arXiv.2105.05094",
        kept="runs/reproduce",
    ),
    "al_hourani_2014": Entry(
        "Al-Hourani, Kandeepan, Lardner: Optimal LAP altitude for maximum coverage. IEEE Wireless "
        "Communications Letters 3(6), 2014",
        al_hourani.rows,
        al_hourani.draw,
        compared="the best elevation, radius and height in four environments",
        doi="10.1109/LWC.2014.2342736",
    ),
    "class_rings": Entry(
        "Rings of classes, from the path loss of Al-Hourani, Kandeepan, Lardner 2014",
        class_rings.rows,
        class_rings.draw,
        compared="the radii of link classes",
    ),
    "mozaffari_2015": Entry(
        "Mozaffari, Saad, Bennis, Debbah: Drone small cells in the clouds: design, deployment and "
        "performance analysis. IEEE GLOBECOM 2015",
        mozaffari_2015.rows,
        mozaffari_2015.draw,
        compared="the best altitude, the least power, and the separation of two drones",
        doi="10.48550/arXiv.1509.01655",
    ),
    "mozaffari_2016": Entry(
        "Mozaffari, Saad, Bennis, Debbah: Efficient deployment of multiple unmanned aerial "
        "vehicles for optimal wireless coverage. IEEE Communications Letters 20(8), 2016",
        mozaffari_2016.rows,
        mozaffari_2016.draw,
        compared="the radii and coverage of 2 to 9 packed discs",
        doi="10.1109/LCOMM.2016.2578312",
    ),
    "andrews_2011": Entry(
        "Andrews, Baccelli, Ganti: A tractable approach to coverage and rate in cellular networks. "
        "IEEE Transactions on Communications 59(11), 2011",
        andrews.rows,
        andrews.draw,
        compared="the probability of coverage without noise",
        doi="10.1109/TCOMM.2011.100411.100541",
    ),
    "event_a3": Entry(
        "3GPP TS 38.331: event A3, with a loss that follows a power law",
        a3.rows,
        compared="the place of a handover",
    ),
    "tr_36777": Entry(
        "3GPP TR 36.777 V15.0.0: Enhanced LTE support for aerial vehicles, annex B",
        tr_36777.rows,
        tr_36777.draw,
        compared="line of sight and path loss of aerial users",
    ),
    "yoon_2003": Entry(
        "Yoon, Liu, Noble: Random waypoint considered harmful. IEEE INFOCOM 2003",
        random_waypoint.decay_rows,
        random_waypoint.draw,
        compared="the decay of the mean speed",
        doi="10.1109/INFCOM.2003.1208967",
    ),
    "navidi_camp_2004": Entry(
        "Navidi, Camp: Stationary distributions for the random waypoint mobility model. IEEE "
        "Transactions on Mobile Computing 3(1), 2004",
        random_waypoint.cure_rows,
        compared="the stationary start, and the positions",
    ),
    "zeng_2019": Entry(
        "Zeng, Xu, Zhang: Energy minimization for wireless communication with rotary-wing UAV. "
        "IEEE Transactions on Wireless Communications 18(4), 2019",
        zeng.rows,
        zeng.draw,
        compared="the power of flight, the best speeds, and the orderings of four schemes",
        doi="10.1109/TWC.2019.2902559",
    ),
    "zeng_2017": Entry(
        "Zeng, Zhang: Energy-efficient UAV communication with trajectory optimization. IEEE "
        "Transactions on Wireless Communications 16(6), 2017",
        zeng.wing_rows,
        compared="the best speeds of a fixed-wing drone",
        doi="10.1109/TWC.2017.2688328",
    ),
    "wu_2018": Entry(
        "Wu, Zeng, Zhang: Joint trajectory and communication design for multi-UAV enabled wireless "
        "networks. IEEE Transactions on Wireless Communications 17(3), 2018",
        wu_2018.rows,
        wu_2018.draw,
        compared="the bound of the max-min rate; static, circular and optimised flights",
        doi="10.1109/TWC.2017.2789293",
    ),
    "zhang_2017": Entry(
        "Zhang, Zeng, Zhang: Cellular-enabled UAV communication: trajectory optimization under "
        "connectivity constraint. IEEE ICC 2018",
        zhang_2017.rows,
        zhang_2017.draw,
        compared="the shortest flights on which a base station is always heard",
        doi="10.48550/arXiv.1710.11619",
    ),
    "kaul_2012": Entry(
        "Kaul, Yates, Gruteser: Real-time status: how often should one update? IEEE INFOCOM 2012",
        age_queues.first_come_rows,
        age_queues.draw_first_come,
        compared="the age over the load in M/M/1, M/D/1 and D/M/1, and the best loads",
        doi="10.1109/INFCOM.2012.6195689",
        scenarios=(age_queues.SCENARIO,),
    ),
    "costa_2016": Entry(
        "Costa, Codreanu, Ephremides: On the age of information in status update systems with "
        "packet management. IEEE Transactions on Information Theory 62(4), 2016",
        age_queues.small_buffer_rows,
        age_queues.draw_small_buffers,
        compared="the age over the load in M/M/1/1, M/M/1/2 and M/M/1/2*",
        doi="10.1109/TIT.2016.2533395",
        scenarios=(age_queues.SCENARIO,),
    ),
    "wang_2021": Entry(
        "Wang, Fang, Ding, Xiong: Computation offloading optimization for UAV-assisted mobile edge "
        "computing: a deep deterministic policy gradient approach. Wireless Networks 27, 2021",
        wang_2021.rows,
        wang_2021.draw,
        compared="the delay of tasks over their size, and that of a learned share",
        doi="10.1007/s11276-021-02632-z",
        scenarios=(wang_2021.ONE_TASK, wang_2021.LEARNED),
    ),
    "bayerlein_2021": Entry(
        "Bayerlein, Theile, Caccamo, Gesbert: Multi-UAV path planning for wireless data harvesting "
        "with deep reinforcement learning. IEEE Open Journal of the Communications Society 2, 2021",
        bayerlein_2021.rows,
        bayerlein_2021.draw,
        compared="the shares of missions that land, and of data that is collected",
        doi="10.1109/OJCOMS.2021.3081996",
        scenarios=(SCENARIO,),
    ),
    "do_2026": Entry(
        "Do: Congestion-aware joint charging-station placement, capacity, and swarm-UAV trajectory "
        "design for age-optimal data collection. Manuscript with code, 2026",
        do_2026.rows,
        do_2026.draw,
        compared="the best number of drones for 1 to 4 charging pads",
        scenarios=(do_2026.SCENARIO,),
    ),
}
"""The papers, by the names that the command takes."""
