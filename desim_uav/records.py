"""The tables of a run: their columns and types. Times in seconds from the episode's start."""

from __future__ import annotations

from desim_uav.columns import BOOL, FLOAT, INT, LIST, MAYBE, TEXT, Columns
from desim_uav.model.rules import Mode

_MODES = [f"`{mode.name.lower()}`" for mode in Mode]
_EPISODE = (INT, "The number of the episode, from 0. Warm-up episodes have negative numbers.")
_DRONE = (INT, "The number of the drone, from 0.")
_QOE1_PERCENT = (FLOAT, "QoE1 of the episode, in percent. Null if nothing was asked for.")
_QOE2_ITERATIONS = (FLOAT, "QoE2 of the episode, in steps. Null if nothing was asked for.")
_QOE3_PERCENT = (FLOAT, "QoE3 of the episode, in percent.")

VOLUMES = Columns(
    "If a service asks for a volume:",
    requested_mbit=(
        FLOAT,
        "The volume that the request asks for, in Mbit. Null if it asks for a service time.",
    ),
    delivered_mbit=(FLOAT, "The volume that was delivered, in Mbit. Null as above."),
    throughput_kbps=(
        FLOAT,
        "`delivered_mbit` over the time for which the request was open, in kbit/s. Null as above, "
        "or if this time is 0.",
    ),
)

STAGES = Columns(
    "If a service has several stages:",
    stages=(INT, "How many stages the request has."),
    stages_done=(INT, "How many of them have been done."),
    stage_done=(
        FLOAT,
        "The share of the next stage that has been done. 0 if the request is completed.",
    ),
)

TASKS = Columns(
    "If a service has tasks, which need a processor or have a deadline:",
    gigacycles=(FLOAT, "The cycles of a processor that the request needs, in 10^9."),
    offloaded=(FLOAT, "The part of it that is offloaded, from 0 to 1."),
    waiting_s=(FLOAT, "Seconds for which the request was open, but neither sent nor computed."),
    sending_s=(FLOAT, "Seconds for which its input or its result was sent."),
    computing_s=(FLOAT, "Seconds for which a drone or an access point computed it."),
    own_s=(FLOAT, "Seconds for which the user's own processor computed it."),
    restarts=(INT, "How often it began anew because a drone that had received it crashed."),
    deadline_s=(FLOAT, "When the request is late. Null if it has no deadline."),
    late=(MAYBE, "Whether it missed its deadline. Null without one, or if it is not over."),
)

OWN = Columns(
    "If users have a processor:",
    user_j=(
        FLOAT,
        "What the user's device used for it, in J: for the cycles that it did itself, and for "
        "sending the input. Null for users without a processor.",
    ),
)

GROUPED = Columns(
    "If the users are a list of groups:",
    group=(TEXT, "The name of the user's group."),
)

REQUESTS = Columns(
    "One row per request. Every request that was made is there, also if it was never served.",
    VOLUMES,
    STAGES,
    TASKS,
    OWN,
    GROUPED,
    episode=_EPISODE,
    request_id=(INT, "The number of the request in its episode, from 0."),
    user=(INT, "The number of the user, from 0."),
    service=(TEXT, "The name of the service."),
    t_request_s=(FLOAT, "When the user made the request."),
    t_first_service_s=(FLOAT, "When the request was first served. Null if it never was."),
    t_end_s=(FLOAT, "When the request was completed, refused, or closed by the episode's end."),
    requested_s=(
        FLOAT,
        "The service time that the request requires, in seconds, in all its stages together. Null "
        "if one of them asks for a volume.",
    ),
    served_s=(FLOAT, "The service time that the request received, in seconds."),
    bandwidth_kbps=(FLOAT, "The rate that the request holds while it is served, in kbit/s."),
    wait_s=(
        FLOAT,
        "Seconds from the request to its first service, or to its end if there is none.",
    ),
    completion_s=(
        FLOAT,
        "Seconds from the request to its completion. Null if it was not completed.",
    ),
    interruptions=(INT, "How often service stopped and the request then went unserved for a time."),
    handovers=(INT, "How often the request went from one drone to another."),
    drones=(LIST, "The drones that served the request, in order, without immediate repetitions."),
    outcome=(
        TEXT,
        "`completed`, `unfinished` or `never_served`; `late` if it was dropped at its deadline; "
        "`dropped` if it was an update of a sensor whose buffer made room for a new one.",
    ),
    qoe1=(
        FLOAT,
        "What was served over what was requested, of time or volume, from 0 to 1. For a request of "
        "several stages, those done and the share of the next one, over all.",
    ),
    qoe1_feasible=(
        FLOAT,
        "`served_s` over the part of `requested_s` that fits before the episode's end. "
        "Null if no time was left, if the request asks for a volume, or if it has several stages.",
    ),
    qoe2_iterations=(FLOAT, "The time the request was open but not served, in steps."),
    attached_s=(FLOAT, "Seconds for which the user was attached to a drone while it was open."),
)
"""The columns of requests. QoE3 of active users follows from ``attached_s``."""

STORED = Columns(
    "If batteries are measured in Wh:",
    battery_wh=(FLOAT, "What its battery holds, in Wh. Null if batteries are not measured in Wh."),
    n_b_wh=(FLOAT, "`n_b_s` in Wh. Null as above, or if there is no way."),
    energy_wh=(FLOAT, "What the drone has used in this step, in Wh. Null as above."),
)

AIMED = Columns(
    "If drones fly freely (`motion: {space: free}`); null for those that fly from cell to cell:",
    aim_x=(
        FLOAT,
        "The displacement to the east that was commanded at the start of the step, as a share of "
        "the furthest; `action` and `action_taken` are `fly` if it was followed.",
    ),
    aim_y=(FLOAT, "The same to the north."),
    aim_z=(FLOAT, "The same upwards; 0 in 2D."),
)

CHOSEN = Columns(
    "If drones fly freely and choose their speed (`motion: {space: free, cruise: [4, 12]}`), or a "
    "share of tasks (`offloading: {kind: commanded}`):",
    aim_cruise=(FLOAT, "The cruise speed that was commanded: -1 is the lowest, 1 the highest."),
    aim_share=(FLOAT, "The same for the share of tasks that is offloaded."),
)

STEPS = Columns(
    "One row per step and drone: the state at the end of the step, before the next command.",
    STORED,
    AIMED,
    CHOSEN,
    episode=_EPISODE,
    step=(INT, "The number of the step in its episode, from 0."),
    t_s=(FLOAT, "The time of the end of the step."),
    drone=_DRONE,
    x_m=(FLOAT, "The true position of the drone to the east, in metres."),
    y_m=(FLOAT, "The true position of the drone to the north, in metres."),
    z_m=(FLOAT, "The altitude of the drone, in metres. 0 if it has crashed."),
    battery_s=(
        FLOAT,
        "Seconds of flight that its battery holds, or of hovering if the battery is measured in "
        "Wh. Null if batteries are unlimited.",
    ),
    mode=(TEXT, f"{', '.join(_MODES[:-1])} or {_MODES[-1]}."),
    action=(TEXT, "The action that was commanded at the start of the step. Null if it was none."),
    action_taken=(TEXT, "The action that was taken. It differs if the command was masked."),
    attached_users=(INT, "How many users are attached to the drone."),
    served_requests=(INT, "How many requests the drone is serving."),
    bandwidth_khz=(FLOAT, "The bandwidth in use at the drone, in kHz."),
    n_b_s=(
        FLOAT,
        "The battery, in seconds of flight, that the quickest return to a charging station takes "
        "from where the drone believes it is. Null if there is no way, or no limited battery.",
    ),
    crashed=(BOOL, "Whether the drone lies crashed."),
    reward=(FLOAT, "The reward of the drone for this step."),
)

POINTS = Columns(
    "One row per step and access point, at the end of the step. Kept if there are access points.",
    episode=_EPISODE,
    step=(INT, "The number of the step in its episode, from 0."),
    t_s=(FLOAT, "The time of the end of the step."),
    access_point=(
        INT,
        "The number of the access point, from 0. Among the drones of events and requests, access "
        "points have the numbers after those of the drones.",
    ),
    attached_users=(INT, "How many users are attached to the access point."),
    served_requests=(INT, "How many requests the access point is serving."),
    bandwidth_khz=(FLOAT, "The bandwidth in use at the access point, in kHz."),
)

LINKS = Columns(
    "If the drones' radio is not the paper's disc:",
    link_handovers=(INT, "How often a user passed from one drone to another without a break."),
    ping_pongs=(INT, "How many of these handovers led back, within 1 s, to the drone before."),
    outages=(INT, "How often a user with an open request had no link to any drone for a time."),
    outage_s=(FLOAT, "Seconds in such outages, summed over the users."),
    delivered_mbit=(FLOAT, "The volume that was delivered to all users together, in Mbit."),
)

APART = Columns(
    "If drones have to keep a distance (`separation_m`):",
    conflicts=(INT, "How often two drones in the air came nearer than `separation_m`."),
    conflict_s=(FLOAT, "Seconds for which two drones were that near, summed over pairs of drones."),
    least_distance_m=(
        FLOAT,
        "The least distance of two drones in the air, in metres. Null if never two were.",
    ),
)

ENERGY = Columns(
    "If batteries are measured in Wh:",
    energy_wh=(
        FLOAT,
        "What the drones used in flight, in Wh, summed over those whose batteries are measured in "
        "Wh.",
    ),
    charged_wh=(FLOAT, "What these drones were charged with, in Wh, summed over them."),
    served_mbit=(
        FLOAT,
        "What was served to all users together, in Mbit: the rate of a request times the time for "
        "which it was served, or the volume that was delivered.",
    ),
    j_per_mbit=(
        FLOAT,
        "`energy_wh` in joules over `served_mbit`. Null if nothing was served, or if the batteries "
        "of some drones are not measured in Wh.",
    ),
)

AGES = Columns(
    "If users are sensors, whose demand is `sensing`:",
    age_s=(FLOAT, "The time average of the age of a sensor, in seconds; the mean over sensors."),
    peak_age_s=(
        FLOAT,
        "The mean of the ages just before they fell, in seconds, over all sensors. Null if none "
        "fell.",
    ),
    worst_age_s=(FLOAT, "The largest time average of the age of a sensor, in seconds."),
    updates=(INT, "How many updates the sensors have taken."),
    updates_delivered=(INT, "How many of them have been delivered."),
    updates_dropped=(INT, "How many of them were dropped because a buffer was full."),
    updates_lost=(INT, "How many of them were lost in crashes."),
    age_violation_s=(
        FLOAT,
        "Seconds for which the age of a sensor was above `age_limit_s`, summed over sensors. Null "
        "if there is no limit.",
    ),
)

EPISODES = Columns(
    "One row per episode: its measures.",
    LINKS,
    APART,
    ENERGY,
    AGES,
    episode=_EPISODE,
    qoe1_percent=_QOE1_PERCENT,
    qoe2_iterations=_QOE2_ITERATIONS,
    qoe3_percent=_QOE3_PERCENT,
    qoe3_active_percent=(
        FLOAT,
        "QoE3 of users with an open request, in percent: their time attached over the time they "
        "had a request open. Null if nothing was asked for.",
    ),
    crashes=(INT, "How many drones crashed."),
    requests=(INT, "How many requests were made."),
    reward=(FLOAT, "The sum of the rewards of the steps, averaged over the drones."),
    qoe1_feasible_percent=(
        FLOAT,
        "The mean of `qoe1_feasible` over the requests, in percent. Null if there is none.",
    ),
    suppressed=(
        INT,
        "How many arrivals were dropped because the user had a request open at that time.",
    ),
    charges=(INT, "How often a drone was charged until its battery was full."),
    queueing_s=(FLOAT, "Seconds for which drones waited for a charging pad, summed over them."),
    distance_m=(FLOAT, "Metres flown within the episode, summed over the drones."),
    bandwidth_percent=(
        FLOAT,
        "The time average of the bandwidth in use over that of all drones, in percent. "
        "Null if bandwidth is unlimited.",
    ),
    fairness=(
        FLOAT,
        "Jain's fairness index of the users' mean QoE1: 1 if all users fare alike. "
        "Null if it is not defined.",
    ),
    duration_s=(FLOAT, "How long the episode lasted, in seconds."),
)

USERS = Columns(
    "One row per way point of a user's walk. Users walk straight from one to the next.",
    GROUPED,
    episode=_EPISODE,
    user=(INT, "The number of the user, from 0."),
    t_s=(FLOAT, "When the user is there."),
    x_m=(FLOAT, "The position to the east, in metres."),
    y_m=(FLOAT, "The position to the north, in metres."),
    z_m=(FLOAT, "The height of the user, in metres: above 0 in a building."),
)

CLASSES = Columns(
    "If the drones' radio is not the paper's disc:",
    link_class=(
        "Int64",
        "The class of the link between drone and user from now on, if that has changed.",
    ),
)

OTHERS = Columns(
    "If drones have to keep a distance (`separation_m`):",
    other=("Int64", "The other drone of an event of two drones."),
)

BEGUN = Columns(
    "If a service has several stages:",
    stage=("Int64", "The number of the stage that the request begins, from 0."),
)

NUMBERED = Columns(
    "If users are sensors:",
    update=("Int64", "The update of a sensor that it concerns, if any."),
)

EVENTS = Columns(
    "One row per event, sorted by time, phase, drone and user. Kept with `--events`.",
    CLASSES,
    OTHERS,
    BEGUN,
    NUMBERED,
    episode=_EPISODE,
    t_us=(INT, "The time of the event, in microseconds."),
    phase=(INT, "The phase of the instant in which it happened, from 1 to 13."),
    kind=(TEXT, "What happened."),
    drone=("Int64", "The drone it concerns, if any."),
    user=("Int64", "The user it concerns, if any."),
    request_id=("Int64", "The request it concerns, if any."),
    station=("Int64", "The charging station it concerns, if any."),
)
"""The columns of events, which are sorted by (t_us, phase, drone, user)."""

UPDATES = Columns(
    "One row per update that a sensor has taken. Kept if users are sensors.",
    episode=_EPISODE,
    update=(INT, "The number of the update in its episode, from 0, by the time it was taken."),
    user=(INT, "The number of the sensor among the users, from 0."),
    service=(TEXT, "The name of the service."),
    request_id=("Int64", "Its request. Null if it never was the first one in the buffer."),
    size_mbit=(FLOAT, "Its size, in Mbit."),
    t_generated_s=(FLOAT, "When it was taken."),
    t_sent_s=(FLOAT, "When sending it began. Null if that never was."),
    t_received_s=(FLOAT, "When the last bit of it was received. Null if that never was."),
    drone=("Int64", "The drone or access point that has received it. Null as above."),
    t_delivered_s=(FLOAT, "When it was delivered. Null if it was not."),
    fate=(
        TEXT,
        "`delivered`, `dropped` by the buffer, or `lost` in a crash; at the end of the episode, "
        "`buffered` at the sensor or `stored` in a drone.",
    ),
    t_end_s=(FLOAT, "When that was known."),
    age_before_s=(
        FLOAT,
        "The age of the sensor just before its delivery, in seconds. Null if it was not delivered.",
    ),
    age_after_s=(
        FLOAT,
        "The age just after that, which is lower unless a fresher one was delivered before.",
    ),
)

SENSORS = Columns(
    "One row per episode and sensor. Kept if users are sensors.",
    GROUPED,
    episode=_EPISODE,
    user=(INT, "The number of the sensor among the users, from 0."),
    service=(TEXT, "The name of the service whose updates it sends."),
    age_s=(
        FLOAT,
        "The time average of its age, in seconds: the time since the freshest update that has been "
        "delivered was taken, or since the start of the episode if there is none.",
    ),
    peak_age_s=(FLOAT, "The mean of its ages just before they fell. Null if it never fell."),
    falls=(INT, "How often its age fell."),
    age_end_s=(FLOAT, "Its age at the end of the episode, in seconds."),
    violation_s=(
        FLOAT,
        "Seconds for which its age was above `age_limit_s`. Null if there is no limit.",
    ),
    updates=(INT, "How many updates it has taken."),
    delivered=(INT, "How many of them have been delivered."),
    dropped=(INT, "How many of them its buffer has dropped."),
    lost=(INT, "How many of them were lost in crashes."),
)

LEGS = Columns(
    "One row per transit that a drone flew, and one of duration 0 for each place at which a drone "
    "was put: at an episode's start, on its crash, and as the replacement of another. Between "
    "transits a drone stays where the last one led. Kept with `--events`.",
    episode=_EPISODE,
    t_s=(FLOAT, "When the transit began. Below 0 if it began in the episode before."),
    drone=_DRONE,
    duration_s=(FLOAT, "How long the transit takes, in seconds."),
    mode=(TEXT, "The mode of the drone on it."),
    x_from_m=(FLOAT, "Where it began, to the east, in metres."),
    y_from_m=(FLOAT, "Where it began, to the north, in metres."),
    z_from_m=(FLOAT, "The altitude at which it began, in metres."),
    x_to_m=(FLOAT, "Where it leads, to the east, in metres."),
    y_to_m=(FLOAT, "Where it leads, to the north, in metres."),
    z_to_m=(FLOAT, "The altitude to which it leads, in metres."),
)

TRAINING = Columns(
    "One row per episode and drone of a training.",
    episode=(INT, "The number of the episode, from 0."),
    drone=_DRONE,
    reward=(FLOAT, "The sum of the drone's rewards over the episode's steps."),
    epsilon=(FLOAT, "The probability of a random action in this episode."),
    alpha=(FLOAT, "The learning rate in this episode."),
    mean_q=(FLOAT, "The mean of all values in the drone's table after the episode."),
    qoe1_percent=_QOE1_PERCENT,
    qoe2_iterations=_QOE2_ITERATIONS,
    qoe3_percent=_QOE3_PERCENT,
    crashes=(INT, "How often the drone crashed in the episode."),
)

TABLES = {
    "requests": REQUESTS,
    "steps": STEPS,
    "access_points": POINTS,
    "episodes": EPISODES,
    "users": USERS,
    "events": EVENTS,
    "legs": LEGS,
    "updates": UPDATES,
    "sensors": SENSORS,
    "training": TRAINING,
}
"""Every table by the name of its Parquet file."""
