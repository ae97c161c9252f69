"""What gaits do on flat ground, step by step: contacts, velocity, targets, and the figures that follow from them."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from policies.base import CONTROL_PERIOD, Floats
from policies.gait import TURN
from policies.gaits.policy import Gaits
from policies.legs.contacts import Contacts, duty_factors, landing_offsets, landings, wrapped

Before = Callable[[int, Gaits], None]
"""Called with the control step and the policy before each action; may request gaits."""


def _nothing(step: int, policy: Gaits) -> None:
    return


@dataclass(frozen=True)
class Strides:
    """What n robots did at every control step; entries after a fall mean nothing."""

    commanded: Contacts
    """Which feet were to be on the ground, (steps, n, 4)."""
    measured: Contacts
    """Which feet were, (steps, n, 4)."""
    phase: Floats
    """The policy's clock, rad, (steps, n)."""
    duty: Floats
    """Duty factor in force, (steps, n)."""
    clock_rate: Floats
    """Gait cycles a second in force, Hz, (steps, n)."""
    offsets: Floats
    """Phase offsets in force, rad, (steps, n, 4)."""
    heading_velocity: Floats
    """Forward and lateral m/s, yaw rate rad/s, (steps, n, 3)."""
    tilt: Floats
    """Tilt of the trunk, rad, (steps, n)."""
    overspeed: Floats
    """Share of the joints that turned faster than their rated speed, (steps, n)."""
    targets: Floats
    """Joint targets, rad, (steps, n, 12)."""
    fell: NDArray[np.bool_]
    """(n,)"""

    @property
    def target_rate(self) -> Floats:
        """Fastest that any joint target of each robot moved, rad/s, (n,)."""
        rate: Floats = np.abs(np.diff(self.targets, axis=0)).max(axis=(0, 2)) / CONTROL_PERIOD
        return rate

    def since(self, step: int) -> "Strides":
        """The same from that step on."""
        later = {name: value[step:] for name, value in vars(self).items() if name != "fell"}
        return Strides(**later, fell=self.fell)

    def of(self, robots: NDArray[np.bool_]) -> "Strides":
        """The same of those robots, (n,) bool."""
        theirs = {name: value[:, robots] for name, value in vars(self).items() if name != "fell"}
        return Strides(**theirs, fell=self.fell[robots])

    def duty_errors(self) -> Floats:
        """Measured minus commanded duty factor of each foot, (n, 4)."""
        errors: Floats = duty_factors(self.measured) - self.duty.mean(axis=0)[:, None]
        return errors

    def offset_errors(self) -> Floats:
        """Measured minus commanded phase ahead of the first foot's, cycles, (n, 4); nan if a foot never landed."""
        cycles = (self.phase[..., None] + self.offsets) % TURN / TURN
        landed = landings(self.measured, cycles, self.duty)
        commanded = (self.offsets[-1] - self.offsets[-1][:, :1]) / TURN
        return wrapped(landing_offsets(landed, self.phase) - commanded)


def walked(
    policy: Gaits, command: Floats, seeds: NDArray[np.int64], *, steps: int, nthread: int = 2, before: Before = _nothing
) -> Strides:
    """An episode of `policy` on flat ground for each seed, at held commands (3,) or (n, 3)."""
    from gymnasium.vector import AutoresetMode

    from quad_env.envs.vector_env import SimpleQuadVectorEnv

    count = len(seeds)
    env = SimpleQuadVectorEnv(
        count, nthread=nthread, autoreset_mode=AutoresetMode.DISABLED, max_episode_steps=steps, readings=True
    )
    record: dict[str, list[NDArray[Any]]] = {name: [] for name in Strides.__dataclass_fields__ if name != "fell"}
    try:
        observation, _ = env.reset(seed=seeds.tolist(), options={"command": command})
        policy.reset(count)
        fell = np.zeros(count, np.bool_)
        for step in range(steps):
            before(step, policy)
            action = policy.act(observation)
            observation, _, terminated, _, infos = env.step(action)
            fell |= terminated
            entries = {
                "commanded": ~policy.swing,
                "measured": infos["foot_contact"],
                "phase": policy.phase,
                "duty": policy.duty,
                "clock_rate": policy.clock_rate,
                "offsets": policy.offsets,
                "heading_velocity": infos["heading_velocity"],
                "tilt": infos["tilt"],
                "overspeed": infos["overspeed"],
                "targets": action.astype(np.float64),
            }
            for name, value in entries.items():
                record[name].append(value)
            if terminated.all():
                break
    finally:
        env.close()
    arrays: dict[str, Any] = {name: np.array(values) for name, values in record.items()}
    return Strides(**arrays, fell=fell)
