"""Watch for falls: what is to be said when a robot falls and when it is up again."""

from evaluate.rollouts.observers import Step
from live.ros.topics import RESET
from quad_env.config import FALL_REASONS

UP_TIME = 1.0
"""s without a fall after which a robot counts as up again."""


class FallWatch:
    """Of the first robot, by the environment's rule."""

    def __init__(self, dt: float) -> None:
        """`dt`: control period, s."""
        self._steps_up = round(UP_TIME / dt)
        self._fallen, self._upright = False, 0

    def __call__(self, step: Step) -> str | None:
        """What there is to say after that control step."""
        fall = int(step.infos["fall"][0])
        if step.number <= 1:
            self._fallen = False
        self._upright = 0 if fall else self._upright + 1
        if fall and not self._fallen:
            self._fallen = True
            return f"the robot has fallen ({FALL_REASONS[fall]}); a message on {RESET} starts it anew"
        if self._fallen and self._upright == self._steps_up:
            self._fallen = False
            return "the robot is up again"
        return None
