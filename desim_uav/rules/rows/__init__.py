"""The rows of the model: the constants of a run, then a sample path, then the state of an episode.

Times are whole microseconds since the start of the episode, and negative in an earlier episode.
The time, index or number of what does not exist is -1. ``asks_at`` holds the offsets of requests:
those of user u are ``due_us[asks_at[u]:asks_at[u + 1]]``; ``legs_at`` and ``known_at`` are similar.
"""

from __future__ import annotations

from desim_uav.model.motion.motion import PieceRow
from desim_uav.rules.rows.constants import (
    Constants,
    PointRow,
    ProcessorRow,
    RadioRow,
    TermsRow,
    TypeRow,
    UpdatesRow,
)
from desim_uav.rules.rows.drones import (
    Begun,
    BegunCourse,
    Course,
    Credit,
    Drone,
    ObservationRow,
    Pair,
    Station,
)
from desim_uav.rules.rows.flights import (
    CellRow,
    Hop,
    Move,
    Place,
    PlanRow,
    SpaceRow,
    WaysRow,
)
from desim_uav.rules.rows.logs import (
    Closed,
    EventRow,
    FlownRow,
    Handover,
    PointRecord,
    Record,
    UpdateRow,
)
from desim_uav.rules.rows.sample_path import Path
from desim_uav.rules.rows.state import LookRow, State
from desim_uav.rules.rows.users import (
    Freight,
    Request,
    Sensor,
    Spot,
    Task,
    Update,
    Upload,
    User,
    UserLinks,
    Wide,
)
from desim_uav.sky.rows import Change, TransitRow
