"""How far the joints follow their targets: slow or weak motors move them less than they are commanded."""

import numpy as np

from policies.gait_cycle import Floats
from policies.legs.memory import Memory, taken_in

MEMORY_TIME = 0.3
"""Time constant of both movements, s: about two strides."""
AT_FIRST = 10.0
"""Speed of each joint at the start, both commanded and made, rad/s: nothing is known yet."""


class Following:
    """The joints' movement per that of their targets, robots (n,), over the last strides."""

    def __init__(self, joints: int, control_period: float) -> None:
        self._share = taken_in(control_period, MEMORY_TIME)
        first = AT_FIRST * control_period * joints
        # The names of the movements are part of the digest by which results know the policy.
        self.memory = Memory(told=first, made=first, targets=np.zeros(joints), joints=np.zeros(joints))

    def read(self, joints: Floats, walking: Floats) -> None:
        """The joints' places, (joints, n), rad, one control period after `command`; the robot's share of walking
        weighs them, `walking`, 0 … 1, (n,)."""
        self._move("made", "joints", joints, walking)

    def command(self, targets: Floats, walking: Floats) -> None:
        """The new targets, (joints, n), rad, from the pose that all joints start in, as their places are."""
        self._move("told", "targets", targets, walking)

    @property
    def ratio(self) -> Floats:
        """Movement made per movement commanded, (n,): 1 where all joints follow their targets, 0 where none moves."""
        return self.memory["made"] / np.maximum(self.memory["told"], 1e-9)

    def _move(self, movement: str, places: str, now: Floats, walking: Floats) -> None:
        memory = self.memory
        moved = np.abs(now - memory[places]).sum(axis=0)
        memory[movement] = memory[movement] + self._share * walking * (moved - memory[movement])
        memory[places] = now
