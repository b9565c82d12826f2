"""The measures that are known: what each is, from which table, and which scenarios have it."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Sequence
from dataclasses import dataclass

from desim_uav.errors import UsageError, did_you_mean
from desim_uav.measures.where import (
    APART,
    EVERYWHERE,
    GRADED,
    IN_JOULES,
    LIMITED,
    NOWHERE,
    OWN,
    SENSORS,
    SOME_IN_JOULES,
    TASKS,
    TASKS_IN_JOULES,
    TASKS_OR_SENSORS,
    VOLUMES,
    Where,
)
from desim_uav.scenario.schema import Scenario

HIGHER, LOWER = "higher", "lower"


@dataclass(frozen=True)
class Measure:
    """A measure of a run, which is one number for all its counted episodes together.

    ``better`` is HIGHER, LOWER or None. ``table`` is what it follows from. ``label`` and ``form``
    are its heading and format where it has a line, or is drawn; ``narrow`` is the heading, with
    line breaks, and ``short`` the format where it has one of many columns. Scenarios of ``where``
    have it; comparisons and sweeps have it in those of ``compared``, unless others are asked for.
    """

    name: str
    label: str
    unit: str
    better: str | None
    table: str
    meaning: str
    form: str
    narrow: str = ""
    short: str = ""
    where: Where = EVERYWHERE
    compared: Where = NOWHERE

    def verdict(self, difference: float) -> str:
        """Return whether it is better or worse by a difference; "" if neither, or if it is 0."""
        if self.better is None or difference == 0:
            return ""
        return "better" if (difference > 0) == (self.better == HIGHER) else "worse"


_LISTED = (
    Measure(
        *("requests", "requests", "", None, "requests"),
        "How many requests were made.",
        "d",
    ),
    Measure(
        *("qoe1_percent", "QoE1 %", "%", HIGHER, "requests"),
        "The mean of the shares of what was requested that were served, over all requests.",
        *(".2f", "QoE1\n%", ".1f"),
        compared=EVERYWHERE,
    ),
    Measure(
        *("qoe1_feasible_percent", "feasible QoE1 %", "%", HIGHER, "requests"),
        "The same, of the part of the requested service time that fits before the episode's end.",
        *(".2f", "feasible\nQoE1 %", ".1f"),
        compared=EVERYWHERE,
    ),
    Measure(
        *("qoe2_iterations", "QoE2 steps", "steps", LOWER, "requests"),
        "The mean time for which a request was open and not served, in steps.",
        *(".3f", "QoE2\nsteps", ".2f"),
        compared=EVERYWHERE,
    ),
    Measure(
        *("qoe3_percent", "QoE3 %", "%", HIGHER, "episodes"),
        "The share of the users' time in which they were attached, a mean over episodes.",
        *(".2f", "QoE3\n%", ".1f"),
        compared=EVERYWHERE,
    ),
    Measure(
        *("qoe3_active_percent", "active QoE3 %", "%", HIGHER, "requests"),
        "The share of the time in which requests were open in which their users were attached.",
        *(".2f", "active\nQoE3 %", ".1f"),
        compared=EVERYWHERE,
    ),
    Measure(
        *("crashes_per_drone_episode", "crashes/drone/ep.", "", LOWER, "episodes"),
        "How many drones crashed, over the number of drones and of episodes.",
        *(".4f", "", ".3f"),
        compared=EVERYWHERE,
    ),
    Measure(
        *("reward_mean", "reward", "", HIGHER, "episodes"),
        "The sum of the rewards of a drone in an episode, a mean over drones and episodes.",
        *(".3f", "", ".2f"),
        compared=EVERYWHERE,
    ),
    Measure(
        *("completed", "completed", "", HIGHER, "requests"),
        "How many requests were completed.",
        *("d", "comp-\nleted"),
    ),
    Measure(
        *("unfinished", "unfinished", "", LOWER, "requests"),
        "How many requests were served, but not completed.",
        *("d", "unfin-\nished"),
    ),
    Measure(
        *("never_served", "never served", "", LOWER, "requests"),
        "How many requests were never served.",
        *("d", "never\nserved"),
    ),
    Measure(
        *("wait_s", "wait s", "s", LOWER, "requests"),
        "The mean time from a request to its first service, or to its end if there was none.",
        ".3f",
    ),
    Measure(
        *("interruptions", "interruptions", "", LOWER, "requests"),
        "How often service stopped and a request then went unserved for a time.",
        "d",
    ),
    Measure(
        *("handovers", "handovers", "", None, "requests"),
        "How often a request went from one drone to another.",
        "d",
    ),
    Measure(
        *("suppressed", "suppressed", "", LOWER, "episodes"),
        "How many arrivals were dropped because the user had a request open.",
        "d",
    ),
    Measure(
        *("crashes", "crashes", "", LOWER, "episodes"),
        "How many drones crashed.",
        "d",
    ),
    Measure(
        *("completion_s", "delay s", "s", LOWER, "requests"),
        "The mean delay: from a request to its completion, over those that were completed.",
        *(".3f", "delay\ns"),
        compared=TASKS,
    ),
    Measure(
        *("completion_p95_s", "95 % of delays s", "s", LOWER, "requests"),
        "The 95th percentile of these delays, with linear interpolation between two of them.",
        *(".3f", "95 %\ns"),
        where=TASKS,
        compared=TASKS,
    ),
    Measure(
        *("waiting_s", "waiting s", "s", LOWER, "requests"),
        "The mean time of completed requests in which they were neither sent nor computed.",
        *(".3f", "waiting\ns"),
        where=TASKS,
        compared=TASKS,
    ),
    Measure(
        *("sending_s", "sending s", "s", LOWER, "requests"),
        "The mean time of completed requests in which their input or result was sent.",
        *(".3f", "sending\ns"),
        where=TASKS,
        compared=TASKS,
    ),
    Measure(
        *("computing_s", "computing s", "s", LOWER, "requests"),
        "The mean time of completed requests in which a drone or access point computed them.",
        *(".3f", "comp-\nuting s"),
        where=TASKS,
        compared=TASKS,
    ),
    Measure(
        *("own_s", "own s", "s", None, "requests"),
        "The mean time of completed requests in which the user's own processor computed them.",
        *(".3f", "own\ns"),
        where=TASKS,
        compared=OWN,
    ),
    Measure(
        *("deadlines_met_percent", "in time %", "%", HIGHER, "requests"),
        "The share of requests done by their deadline, of those that were done or are late.",
        *(".2f", "in time\n%", ".1f"),
        where=TASKS,
        compared=TASKS,
    ),
    Measure(
        *("late", "late and dropped", "", LOWER, "requests"),
        "How many requests were dropped at their deadline.",
        *("d", "late,\ndropped"),
        where=TASKS,
    ),
    Measure(
        *("restarts", "begun anew", "", LOWER, "requests"),
        "How often a request began anew because a drone that had received it crashed.",
        *("d", "begun\nanew"),
        where=TASKS,
    ),
    Measure(
        *("throughput_mbps", "throughput Mbit/s", "Mbit/s", HIGHER, "requests, episodes"),
        "What was delivered of the volumes of all requests, over the time of the episodes.",
        *(".3f", "Mbit/s", ".3f"),
        where=VOLUMES,
        compared=VOLUMES,
    ),
    Measure(
        *("drone_j_per_task", "drones' J per task", "J", LOWER, "requests, episodes"),
        "What all drones used in flight, over the number of tasks that were completed.",
        *(".1f", "drones\nJ/task"),
        where=TASKS_IN_JOULES,
        compared=TASKS_IN_JOULES,
    ),
    Measure(
        *("user_j_per_task", "users' J per task", "J", LOWER, "requests"),
        "What users with a processor used for tasks, over the number of these completed.",
        *(".3f", "users\nJ/task"),
        where=OWN,
        compared=OWN,
    ),
    Measure(
        *("j_per_mbit", "J per Mbit", "J/Mbit", LOWER, "episodes"),
        "What all drones used in flight, over what was served.",
        *(".2f", "J per\nMbit"),
        where=IN_JOULES,
        compared=IN_JOULES,
    ),
    Measure(
        *("age_s", "age s", "s", LOWER, "sensors, episodes"),
        "The time average of the age of a sensor over all episodes, a mean over sensors.",
        *(".2f", "age\ns", ".1f"),
        where=SENSORS,
        compared=SENSORS,
    ),
    Measure(
        *("peak_age_s", "peak age s", "s", LOWER, "sensors"),
        "The mean of the ages just before they fell, over all falls of all sensors.",
        *(".2f", "peak\nage s", ".1f"),
        where=SENSORS,
        compared=SENSORS,
    ),
    Measure(
        *("worst_age_s", "worst age s", "s", LOWER, "sensors, episodes"),
        "The time average of the age, over all episodes, of the sensor where it is largest.",
        *(".2f", "worst\nage s", ".1f"),
        where=SENSORS,
        compared=SENSORS,
    ),
    Measure(
        *("age_violation_percent", "above limit %", "%", LOWER, "sensors, episodes"),
        "The share of the time of sensors with an `age_limit_s` in which the age was above it.",
        *(".2f", "above\nlimit %", ".1f"),
        where=SENSORS,
        compared=LIMITED,
    ),
    Measure(
        *("updates", "updates", "", None, "sensors"),
        "How many updates sensors have taken.",
        "d",
        where=SENSORS,
    ),
    Measure(
        *("updates_delivered", "delivered", "", HIGHER, "sensors"),
        "How many of them were delivered.",
        *("d", "deli-\nvered"),
        where=SENSORS,
        compared=SENSORS,
    ),
    Measure(
        *("updates_dropped", "dropped", "", LOWER, "sensors"),
        "How many of them were dropped by buffers.",
        *("d", "drop-\nped"),
        where=SENSORS,
        compared=SENSORS,
    ),
    Measure(
        *("updates_lost", "lost", "", LOWER, "sensors"),
        "How many of them were lost in crashes.",
        "d",
        where=SENSORS,
        compared=SENSORS,
    ),
    Measure(
        *("fairness", "Jain's index", "", HIGHER, "requests"),
        "Jain's index of the users' mean QoE1: 1 if all fare alike, 1/n if one of n has all.",
        *(".4f", "fairness"),
        compared=TASKS_OR_SENSORS,
    ),
    Measure(
        *("worst_tenth_qoe1_percent", "worst tenth QoE1 %", "%", HIGHER, "requests"),
        "The mean QoE1 of the tenth of users with the lowest, at least of one.",
        *(".2f", "worst tenth\nQoE1 %"),
        compared=TASKS_OR_SENSORS,
    ),
    Measure(
        *("link_handovers", "handovers of links", "", None, "episodes"),
        "How often a user passed from one drone to another without a break.",
        "d",
        where=GRADED,
    ),
    Measure(
        *("ping_pongs", "ping-pongs", "", LOWER, "episodes"),
        "How many of these handovers led back, within 1 s, to the drone before.",
        "d",
        where=GRADED,
    ),
    Measure(
        *("outages", "outages", "", LOWER, "episodes"),
        "How often a user with an open request had no link to any drone for a time.",
        "d",
        where=GRADED,
    ),
    Measure(
        *("outage_s", "outage s", "s", LOWER, "episodes"),
        "Seconds in such outages, summed over users.",
        ".1f",
        where=GRADED,
    ),
    Measure(
        *("delivered_mbit", "delivered Mbit", "Mbit", HIGHER, "episodes"),
        "The volume that was delivered to all users together.",
        ".1f",
        where=GRADED,
    ),
    Measure(
        *("conflicts", "conflicts", "", LOWER, "episodes"),
        "How often two drones in the air came nearer than `separation_m`.",
        "d",
        where=APART,
    ),
    Measure(
        *("conflict_s", "conflict s", "s", LOWER, "episodes"),
        "Seconds for which two drones were that near, summed over pairs.",
        ".1f",
        where=APART,
    ),
    Measure(
        *("least_distance_m", "least distance m", "m", HIGHER, "episodes"),
        "The least distance of two drones in the air.",
        ".1f",
        where=APART,
    ),
    Measure(
        *("energy_wh", "energy Wh", "Wh", LOWER, "episodes"),
        "What drones with such batteries used in flight.",
        ".2f",
        where=SOME_IN_JOULES,
    ),
    Measure(
        *("charged_wh", "charged Wh", "Wh", None, "episodes"),
        "What these drones were charged with.",
        ".2f",
        where=SOME_IN_JOULES,
    ),
    Measure(
        *("served_mbit", "served Mbit", "Mbit", HIGHER, "episodes"),
        "What was served to all users together.",
        ".1f",
        where=SOME_IN_JOULES,
    ),
)

KNOWN = {measure.name: measure for measure in _LISTED}
"""Every measure by its name."""

ALWAYS = tuple(name for name, measure in KNOWN.items() if measure.compared is EVERYWHERE)
"""The measures that comparisons and sweeps have in every scenario."""


def compared_in(*scenarios: Scenario) -> tuple[str, ...]:
    """Return the measures that comparisons have in any of some scenarios."""
    return tuple(
        name for name, measure in KNOWN.items() if any(map(measure.compared.holds, scenarios))
    )


def chosen(names: Iterable[str], *scenarios: Scenario) -> tuple[str, ...]:
    """Return these measures, each once.

    Raises UsageError for a name that no measure has, and for one that none of the scenarios has.
    """
    listed = tuple(dict.fromkeys(names))
    for name in listed:
        check(name)
        if not any(map(KNOWN[name].where.holds, scenarios)):
            raise UsageError(f"measure: {name}: {KNOWN[name].where.lack}")
    return listed


def names_of(measure: str | Sequence[str] | None) -> list[str]:
    """Return the names of measures: one, several or none."""
    return [measure] if isinstance(measure, str) else list(() if measure is None else measure)


def check(name: str) -> None:
    """Raise UsageError, with the nearest name, if no measure has this name."""
    if name not in KNOWN:
        raise UsageError(f"measure: {name}{did_you_mean(name, KNOWN)}; allowed: {', '.join(KNOWN)}")


def looks(names: Iterable[str], short: bool = False) -> dict[str, tuple[str, str]]:
    """Return the heading of measures and the format of their means, which may be ``short``."""
    forms = {name: (KNOWN[name].short if short else "") or KNOWN[name].form for name in names}
    return {name: (KNOWN[name].label, of_mean(form)) for name, form in forms.items()}


def of_mean(form: str) -> str:
    """Return the format of a mean of values of this format."""
    return ".1f" if form == "d" else form


def narrow(names: Iterable[str]) -> dict[str, tuple[str, str]]:
    """Return the heading and the format of measures of one run that have a column each."""
    known = [KNOWN[name] for name in names]
    return {one.name: (one.narrow or one.label, one.short or one.form) for one in known}


def compared(there: Collection[str]) -> dict[str, tuple[str, str]]:
    """Return ``looks`` of those measures that are there, in the order in which they are known."""
    return looks(name for name in KNOWN if name in there)


def in_words(names: Sequence[str]) -> str:
    """Return of which of some measures less is better, and of which more, as sentences."""
    words = []
    for better, text in ((HIGHER, "More is better"), (LOWER, "Less is better")):
        labels = [KNOWN[name].label for name in names if KNOWN[name].better == better]
        words += [f"{text}: {', '.join(labels)}."] if labels else []
    return " ".join(words)
