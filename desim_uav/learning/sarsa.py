"""SARSA (Rummery and Niranjan, 1994): learns from the value of the action taken next."""

from desim_uav.learning.rows import Lesson, QValues
from desim_uav.registry import register


@register("algorithm", "sarsa")
class Sarsa:
    """SARSA, with one table per drone."""

    tables = 1

    @staticmethod
    def update(q: QValues, lesson: Lesson) -> None:
        """Update a value by the value of the next action a' that is taken.

        Q(s, a) += α (gained + discount · Q(s', a') - Q(s, a)).
        """
        following = q[0, lesson.next_state, lesson.next_action]
        old = q[0, lesson.state, lesson.action]
        error = lesson.gained + lesson.discount * following - old
        q[0, lesson.state, lesson.action] = old + lesson.alpha * error
