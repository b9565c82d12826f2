"""Double Q-learning (van Hasselt, 2010): one table chooses the next action, the other values it."""

from desim_uav.learning.rows import Lesson, QValues
from desim_uav.registry import register


@register("algorithm", "double_q")
class DoubleQ:
    """Double Q-learning, which chooses actions by the sum of its two tables."""

    tables = 2

    @staticmethod
    def update(q: QValues, lesson: Lesson) -> None:
        """Update the table A that a coin chooses, with the values of the other table B.

        A(s, a) += α (gained + discount · B(s', argmax A(s', ·)) - A(s, a)).
        """
        learns, state = 0 if lesson.coin < 0.5 else 1, lesson.next_state
        best = -1
        for action in range(len(lesson.allowed)):
            if lesson.allowed[action] and (
                best < 0 or q[learns, state, action] > q[learns, state, best]
            ):
                best = action
        following = q[1 - learns, state, best]
        old = q[learns, lesson.state, lesson.action]
        error = lesson.gained + lesson.discount * following - old
        q[learns, lesson.state, lesson.action] = old + lesson.alpha * error
