"""Session: a robot of an episode that a person steers and pushes while it walks."""

from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import ArrayLike

from evaluate.hardware import IDEAL, HardwareConfig
from evaluate.rollouts.observers import Observer, Step
from evaluate.rollouts.rollout import advance, make_env, reset_episodes
from policies.base import Actions, Policy, PolicyError
from policies.gait_cycle import smoothstep
from quad_env.scenarios.scenario import Scenario

POLICY_BLEND_TIME = 0.4
"""Time in which the joint targets pass from where they were into those of a policy that is chosen, s."""


class Session:
    """A robot with the start, ground, pushes and commands of an episode, without a time limit.

    A fallen robot goes on. Commands and pushes are the scenario's until `steer` and `push`. Observers get the start of
    every episode, as step 0, and every control step after it; listeners get a few words about every intervention:
    `reset, seed 4`, `trot chosen`. Sessions of the same scenario and seed have the same episode, whatever their
    policies are.

    Args:
        seed: of the first episode.
        command: held from the first step on, as by `steer`.

    Raises:
        ValueError: a policy that was made for another robot or another control period.
    """

    def __init__(
        self,
        policy: Policy,
        scenario: str | Scenario = "flat",
        *,
        seed: int = 0,
        command: ArrayLike | None = None,
        hardware: HardwareConfig = IDEAL,
        observers: Sequence[Observer] = (),
    ) -> None:
        self.env = make_env(policy, scenario, 1, steps=None, nthread=1, terminate_on_fall=False, hardware=hardware)
        self.policy = policy
        self.observers = list(observers)
        self.listeners: list[Callable[[str], None]] = []
        self.command = None if command is None else np.asarray(command, np.float64)
        """Command that is held, (3,); None where the scenario draws them."""
        self.seed = seed
        """Of the present episode."""
        self._policy_changed_at: int | None = None
        self._offset: Actions | None = None
        try:
            self._check(policy)
            self._begin()
        except BaseException:
            self.close()
            raise

    def reset(self, seed: int | None = None) -> Step:
        """Start an episode, by default that of the next seed; a command that was given stays."""
        self.seed = self.seed + 1 if seed is None else seed
        self.notify(f"reset, seed {self.seed}")
        return self._begin()

    def step(self) -> Step:
        """Move the robot on by a control step."""
        return self._notify_observers(advance(self.latest, self._action())[0])

    def steer(self, command: ArrayLike | None) -> None:
        """Have the robot follow this command, (3,): forward and left m/s, heading frame, yaw rate rad/s.

        None gives the commands back to the scenario, from the next episode on. ValueError for what is no command.
        """
        if command is not None:
            self.env.steer(command)
            self.user_intervened = True
        self.command = None if command is None else np.asarray(command, np.float64)

    def push(self, force: ArrayLike, duration: float) -> None:
        """Push the trunk, with (2,) N, world frame, for a duration, s. ValueError for what is no push."""
        self.env.push(force, duration)
        forward, left = np.asarray(force, np.float64)
        self.user_intervened = True
        self.notify(f"pushed by hand, {np.hypot(forward, left) * duration:.3g} N·s")

    def set_policy(self, policy: Policy) -> None:
        """Replace the policy; joint targets change over within `CHANGE`. Raises ValueError as the constructor, and
        PolicyError where it needs other observations than the first; nothing has changed then."""
        self._check(policy)
        policy.reset(num_envs=1, seed=0)
        self.policy, self._policy_changed_at, self._offset, self.user_intervened = (
            policy,
            self.latest.number,
            None,
            True,
        )
        self.notify(f"{policy.name} chosen")

    def notify(self, event: str) -> None:
        """Send an event to the listeners."""
        for listener in self.listeners:
            listener(event)

    def close(self) -> None:
        """Free the simulation."""
        self.env.close()

    def _check(self, policy: Policy) -> None:
        policy.check_compatible(self.env.robot, self.env.dt)
        if policy.height_scan != self.policy.height_scan:
            raise PolicyError(f"{policy.name} needs other ground heights than {self.policy.name}")

    def _begin(self) -> Step:
        self._policy_changed_at = self._offset = None
        self.user_intervened = False
        """Whether somebody has steered or pushed the robot or changed its policy in the present episode."""
        self.policy.reset(num_envs=1, seed=0)
        return self._notify_observers(reset_episodes(self.env, np.array([self.seed]), self.command))

    def _notify_observers(self, step: Step) -> Step:
        self.latest = step
        for observer in self.observers:
            observer(step)
        return step

    def _action(self) -> Actions:
        action = self.policy.act(self.latest.observation)
        if self._policy_changed_at is None:
            return action
        passed = (self.latest.number - self._policy_changed_at) * self.env.dt / POLICY_BLEND_TIME
        if passed >= 1.0:
            self._policy_changed_at = None
            return action
        if self._offset is None:
            self._offset = self.latest.action - action
        return action + np.float32(1.0 - smoothstep(np.array(passed))) * self._offset
