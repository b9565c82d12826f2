"""Q-learning (Watkins, 1989): learns from the value of the best next action."""

import math

from desim_uav.learning.rows import Lesson, QValues
from desim_uav.registry import register


@register("algorithm", "q_learning")
class QLearning:
    """Q-learning, with one table per drone."""

    tables = 1

    @staticmethod
    def update(q: QValues, lesson: Lesson) -> None:
        """Update a value by the largest value of the next state.

        Q(s, a) += α (gained + discount · max over allowed a' of Q(s', a') - Q(s, a)).
        """
        best = -math.inf
        for action in range(len(lesson.allowed)):
            if lesson.allowed[action]:
                best = max(best, q[0, lesson.next_state, action])
        old = q[0, lesson.state, lesson.action]
        error = lesson.gained + lesson.discount * best - old
        q[0, lesson.state, lesson.action] = old + lesson.alpha * error
