"""Actions, modes, phases and kinds of events as whole numbers, as rows hold them."""

from __future__ import annotations

from desim_uav.model import rules
from desim_uav.model.rules import Action, Mode, Phase

HOVER, GOTO, CHARGE = int(Action.HOVER), int(Action.GOTO_CHARGING_STATION), int(Action.CHARGE)

FLYING, RETURNING, QUEUED, CHARGING, CHARGED, CRASHED = map(int, Mode)
AIRBORNE, GROUNDED, IN_QUEUE, DECIDES, TIMED = (
    tuple(map(int, sorted(modes)))
    for modes in (rules.AIRBORNE, rules.GROUNDED, rules.IN_QUEUE, rules.DECIDES, rules.TIMED)
)
GOING_ON = len(Mode)
"""Stands for the mode of a drone that is asked later (see ``rules.decide.is_under_way``)."""

(
    COMPLETION,
    EXIT,
    ARRIVAL,
    ENTRY,
    REQUEST,
    DEPLETION,
    ATTACHMENT,
    RECORD,
    RESPAWN,
    COMMAND,
    COVERAGE,
    ADMISSION,
    SEPARATION,
) = map(int, Phase)

IDLE, ATTACHED, OPEN, SERVED = range(4)
"""The states of a user (see ``UserState``)."""

RESPAWNS, REMOVES, ENDS_EPISODE = range(3)
CRASHES = {"respawn": RESPAWNS, "remove": REMOVES, "end_episode": ENDS_EPISODE}
"""What happens after a crash (see ``Endurance.on_crash``)."""

EVENT_KINDS = (
    *("request", "serve", "stop", "complete", "refuse", "close"),
    *("enter", "exit", "attach", "detach"),
    *("decide", "depart", "blocked", "arrive", "land", "charge", "charged"),
    *("deplete", "crash", "respawn"),
    *("class", "handover", "ping_pong", "outage", "outage_end"),
    *("conflict", "clear"),
    *("stage", "late", "compute", "computed"),
    *("generate", "drop", "deliver", "lose"),
    "move",
)
"""The names of the kinds of events by number; the next number, ON_LEG, is for ``note_leg``."""

LEADS_TO = {
    "decide": Mode.FLYING,
    "land": Mode.QUEUED,
    "charge": Mode.CHARGING,
    "charged": Mode.CHARGED,
    "crash": Mode.CRASHED,
    "respawn": Mode.FLYING,
}
"""The mode of a drone after each kind of event; after ``depart`` it is that of the leg."""

(
    ON_REQUEST,
    ON_SERVE,
    ON_STOP,
    ON_COMPLETE,
    ON_REFUSE,
    ON_CLOSE,
    ON_ENTER,
    ON_EXIT,
    ON_ATTACH,
    ON_DETACH,
    ON_DECIDE,
    ON_DEPART,
    ON_BLOCKED,
    ON_ARRIVE,
    ON_LAND,
    ON_CHARGE,
    ON_CHARGED,
    ON_DEPLETE,
    ON_CRASH,
    ON_RESPAWN,
    ON_CLASS,
    ON_HANDOVER,
    ON_PING_PONG,
    ON_OUTAGE,
    ON_OUTAGE_END,
    ON_CONFLICT,
    ON_CLEAR,
    ON_STAGE,
    ON_LATE,
    ON_COMPUTE,
    ON_COMPUTED,
    ON_GENERATE,
    ON_DROP,
    ON_DELIVER,
    ON_LOSE,
    ON_MOVE,
    ON_LEG,
) = range(len(EVENT_KINDS) + 1)

OF_PAIRS = (ON_CONFLICT, ON_CLEAR)
"""The kinds of events of two drones."""

OF_UPDATES = (ON_GENERATE, ON_DROP, ON_DELIVER, ON_LOSE)
"""The kinds of events of updates, whose numbers are in the place of a station."""

DELIVERED, DROPPED, LOST_IN_CRASH, BUFFERED, STORED = range(5)
FATES = ("delivered", "dropped", "lost", "buffered", "stored")
"""What becomes of updates: at the end of an episode, some are in a buffer or in a drone's store."""

OUT_OF_MEMORY, TOO_LARGE, OVERBOOKED, LOST, UNFINISHED, NO_SHARE, STRANDED = 1, 2, 4, 8, 16, 32, 64
"""The flags of ``State.faults``: something did not fit in memory; a reward was too large or not a
number; an admission rule served requests beyond a drone's bandwidth; a user's leg is invalid; a
step of the compiled engine is under way, or an error of a component of one's own has ended it; a
share of tasks is invalid; a shielded drone cannot reach a station."""

NEVER = rules.NEVER
"""The time of events that are not scheduled."""

NO_COMMAND = -1
"""Stands for the action that a drone has taken if it has not been commanded yet."""

OWN = -1
"""Stands for the number of a transit that is a drone's own (``Course.flight``), in free flight."""

AIMS = 6
"""The numbers of a command of free flight: x, y and z of the displacement, the cruise speed, the
share of tasks that is offloaded, and the wish to charge."""

FLY = int(Action.FLY)
REST = 0
"""The number of the transit without a distance, which is a hover."""
