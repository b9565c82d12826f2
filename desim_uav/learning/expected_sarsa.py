"""Expected SARSA (van Seijen et al., 2009): learns from the mean value of the ε-greedy choice."""

import math

from desim_uav.learning.rows import Lesson, QValues
from desim_uav.registry import register


@register("algorithm", "expected_sarsa")
class ExpectedSarsa:
    """Expected SARSA, with one table per drone."""

    tables = 1

    @staticmethod
    def update(q: QValues, lesson: Lesson) -> None:
        """Update a value by the expected value of the next ε-greedy choice.

        Q(s, a) += α (gained + discount · ((1 - ε) max Q(s', ·) + ε mean Q(s', ·)) - Q(s, a)).
        """
        best, total, count = -math.inf, 0.0, 0
        for action in range(len(lesson.allowed)):
            if lesson.allowed[action]:
                value = q[0, lesson.next_state, action]
                best = max(best, value)
                total += value
                count += 1
        expected = (1.0 - lesson.epsilon) * best + lesson.epsilon * total / count
        old = q[0, lesson.state, lesson.action]
        error = lesson.gained + lesson.discount * expected - old
        q[0, lesson.state, lesson.action] = old + lesson.alpha * error
