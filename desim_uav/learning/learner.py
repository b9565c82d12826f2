"""The rules of a learner, from decision to decision, and the loop in which drones learn.

Steps in which a drone has no choice (it returns, queues, charges or has crashed) belong to the
decision before them: that decision gains their discounted rewards, and the value of the next
decision, k steps later, is multiplied by γ^k (k is no whole number if drones are asked by event).
The value of a return is thus that of the full
battery to which it leads.

Python runs these functions as they stand, with any engine, observation and algorithm, and compiled
training has them compiled (see ``learning.fused``).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

from desim_uav.learning.rows import EpisodeRow, Learner, value_of
from desim_uav.model.decisions import discount_of
from desim_uav.rowcode.compiled_rows import call
from desim_uav.rowcode.kernels import rule

Parameters = tuple[float, float, float]
"""The parameters of an episode: ε, α, and 1 if the next one begins at the drones' starts, or 0."""


@rule
def play(engine: Any, episode: EpisodeRow, parameters: Parameters) -> None:
    """Play an episode and learn in it."""
    learners = episode.learners
    for d in range(len(learners)):
        learners[d].rewards = 0.0
        learners[d].lesson.epsilon, learners[d].lesson.alpha = parameters[0], parameters[1]
    begin(engine, episode)
    while not (episode.terminated or episode.truncated):
        for d in range(len(learners)):
            decide(learners[d])
        step(engine, episode)
        for d in range(len(learners)):
            gain(learners[d])
    if episode.terminated or parameters[2]:
        for d in range(len(learners)):
            close(episode, learners[d])


def begin(engine: Any, episode: EpisodeRow) -> None:
    """Begin an episode in an engine, and show the learners its first decision epoch."""
    engine.begin(episode)


def step(engine: Any, episode: EpisodeRow) -> None:
    """Give the drones their commands, and show the learners the next decision epoch."""
    engine.step(episode)


@rule
def decide(learner: Learner) -> None:
    """Command the action that a drone chooses, or the only one that is allowed."""
    if learner.decides:
        act(learner)
    else:
        learner.command = nth_allowed(learner.lesson.allowed, 0)
        if learner.lost:
            conclude(learner)


@rule
def act(learner: Learner) -> None:
    """Choose an action, and learn from the decision before it."""
    lesson = learner.lesson
    lesson.next_action = epsilon_greedy(learner)
    learn(learner)
    lesson.state, lesson.action = lesson.next_state, lesson.next_action
    lesson.gained, lesson.discount = 0.0, 1.0
    learner.command = lesson.action


@rule
def epsilon_greedy(learner: Learner) -> int:
    """Return an allowed action for the next state: with probability ε a random one, else the best.

    Of equally good actions, the first one is the best.
    """
    lesson, allowed = learner.lesson, learner.lesson.allowed
    if learner.explore < lesson.epsilon:
        count = 0
        for action in range(len(allowed)):
            count += int(allowed[action])
        return nth_allowed(allowed, int(learner.which * count))
    best, best_value = -1, -math.inf
    for action in range(len(allowed)):
        if allowed[action]:
            value = value_of(learner.q, lesson.next_state, action)
            if best < 0 or value > best_value:
                best, best_value = action, value
    return best


@rule
def nth_allowed(allowed: Sequence[int], nth: int) -> int:
    """Return the allowed action that has ``nth`` others before it."""
    for action in range(len(allowed)):
        if allowed[action]:
            if nth == 0:
                return action
            nth -= 1
    return -1  # every drone is allowed some action


@rule
def gain(learner: Learner) -> None:
    """Add the discounted reward of a step that has ended to the gain of the open decision."""
    lesson = learner.lesson
    lesson.gained += lesson.discount * learner.reward
    if learner.share == 1.0:
        lesson.discount *= learner.gamma
    else:
        lesson.discount *= discount_of(learner.gamma, learner.share)
    learner.rewards += learner.reward


@rule
def close(episode: EpisodeRow, learner: Learner) -> None:
    """Learn from an open decision at the end of an episode whose drones are not carried over.

    A drone that could choose an action now learns with the value of its last state. Nothing is
    learned from the decision of a drone that returns, charges or waits to be replaced, because
    its gain is not known.
    """
    if episode.terminated or learner.lost:
        conclude(learner)
    elif learner.decides:
        act(learner)
    forget(learner)


@rule
def conclude(learner: Learner) -> None:
    """Learn from the open decision at a terminal state, which has no value."""
    lesson = learner.lesson
    lesson.discount = 0.0
    lesson.next_state, lesson.next_action = 0, nth_allowed(lesson.allowed, 0)
    learn(learner)
    forget(learner)


@rule
def forget(learner: Learner) -> None:
    """Forget the open decision."""
    lesson = learner.lesson
    lesson.state, lesson.action = -1, -1
    lesson.gained, lesson.discount = 0.0, 1.0


@rule
def learn(learner: Learner) -> None:
    """Update the tables by the open decision, if there is one."""
    if learner.lesson.state >= 0:
        call(learner.update, (learner.q, learner.lesson))
