"""Simulates one robot in an interactive session, in which a user steers and pushes the robot during an episode.

The live view and the ROS interface use sessions.
"""

from collections.abc import Callable, Sequence
from contextlib import ExitStack

import numpy as np
from numpy.typing import ArrayLike

from evaluate.hardware import IDEAL, HardwareConfig
from evaluate.rollouts.observers import Observer, Step
from evaluate.rollouts.rollout import advance, make_env, reset_episodes
from policies.base import Actions, Policy, PolicyError
from policies.gait_cycle import smoothstep
from quad_env.scenarios.scenario import Scenario

POLICY_BLEND_TIME = 0.4
"""Duration of the transition of the joint targets from the previous policy to a new policy, s."""


class Session:
    """One simulated robot that a user can steer and push, in an episode without a time limit.

    The episode continues after a fall. Commands and pushes come from the scenario until a user calls `steer` or `push`.
    Two sessions with the same scenario and seed have the same initial state, ground, pushes and commands, also if
    their policies differ. A policy that was made for another robot or another control period raises ValueError.

    Args:
        policy: Policy that controls the robot.
        scenario: Scenario of the episodes, or name of a scenario.
        seed: Seed of the first episode.
        command: Fixed velocity command, as in `steer`; None for the commands that the scenario draws.
        hardware: Robot, motors, sensors and simulator.
        observers: Functions that receive the start of every episode, as step 0, and every control step.

    Attributes:
        env: Environment with one robot.
        policy: Policy that controls the robot at present.
        observers: Functions that receive the start of every episode, as step 0, and every control step.
        listeners: Functions that receive a short text about every intervention, for example `trot chosen`.
        command: Fixed velocity command: forward and left velocity, heading frame, m/s, and yaw rate, rad/s, (3,); None
            for the commands that the scenario draws.
        seed: Seed of the present episode.
        latest: Record of the last control step; before the first control step, the record of the start of the episode.
        user_intervened: True if a user steered or pushed the robot or changed the policy in the present episode.
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
        self.seed = seed
        self._policy_changed_at: int | None = None
        self._offset: Actions | None = None
        with ExitStack() as close_on_error:
            close_on_error.callback(self.close)
            self._check(policy)
            self._begin()
            close_on_error.pop_all()

    def reset(self, seed: int | None = None) -> Step:
        """Start a new episode, and return the record of its start, step 0.

        A fixed velocity command stays fixed in the new episode.

        Args:
            seed: Seed of the new episode; None for the present seed plus 1.

        Returns:
            Record of the start of the episode, with observation and infos.
        """
        self.seed = self.seed + 1 if seed is None else seed
        self.notify(f"reset, seed {self.seed}")
        return self._begin()

    def step(self) -> Step:
        """Simulate one control step of the robot, and return its record with observation and infos."""
        return self._notify_observers(advance(self.latest, self._action())[0])

    def steer(self, command: ArrayLike | None) -> None:
        """Fix the velocity command of the robot.

        Args:
            command: Forward and left velocity, heading frame, m/s, and yaw rate, rad/s, (3,). With None, the scenario
                draws the commands from the next episode on. The environment raises ValueError for an invalid command.
        """
        if command is not None:
            self.env.steer(command)
            self.user_intervened = True
        self.command = None if command is None else np.asarray(command, np.float64)

    def push(self, force: ArrayLike, duration: float) -> None:
        """Push the trunk of the robot with a constant force.

        Args:
            force: Horizontal force, world frame, (2,), N. The environment raises ValueError for an invalid force.
            duration: Duration of the push, s.
        """
        self.env.push(force, duration)
        forward, left = np.asarray(force, np.float64)
        self.user_intervened = True
        self.notify(f"pushed by hand, {np.hypot(forward, left) * duration:.3g} N·s")

    def set_policy(self, policy: Policy) -> None:
        """Replace the policy; the joint targets change smoothly to the new targets in POLICY_BLEND_TIME.

        The method raises ValueError if `policy` was made for another robot or control period, and PolicyError if
        `policy` needs another height scan than the present policy. After an error the present policy stays in use.
        """
        self._check(policy)
        policy.reset(num_envs=1, seed=0)
        self.policy = policy
        self._policy_changed_at = self.latest.number
        self._offset = None
        self.user_intervened = True
        self.notify(f"{policy.name} chosen")

    def notify(self, event: str) -> None:
        """Call all listeners with the text `event`, which describes an intervention of the user."""
        for listener in self.listeners:
            listener(event)

    def close(self) -> None:
        """Close the environment of the session, which frees the memory of the simulation."""
        self.env.close()

    def _check(self, policy: Policy) -> None:
        """Raise ValueError or PolicyError if robot, control period or height scan of `policy` do not fit."""
        policy.check_compatible(self.env.robot, self.env.dt)
        if policy.height_scan != self.policy.height_scan:
            raise PolicyError(f"{policy.name} needs other ground heights than {self.policy.name}")

    def _begin(self) -> Step:
        """Start an episode with the present seed, and return the record of its start, step 0."""
        self._policy_changed_at = self._offset = None
        self.user_intervened = False
        self.policy.reset(num_envs=1, seed=0)
        return self._notify_observers(reset_episodes(self.env, np.array([self.seed]), self.command))

    def _notify_observers(self, step: Step) -> Step:
        """Store the record of a control step as `latest`, call all observers with it, and return it."""
        self.latest = step
        for observer in self.observers:
            observer(step)
        return step

    def _action(self) -> Actions:
        """Compute the joint targets of the next control step, (1, 12), rad.

        After a change of the policy, the targets change smoothly to the targets of the new policy. The transition
        starts from the last targets of the previous policy and takes POLICY_BLEND_TIME.
        """
        action = self.policy.act(self.latest.observation)
        if self._policy_changed_at is None:
            return action
        progress = (self.latest.number - self._policy_changed_at) * self.env.dt / POLICY_BLEND_TIME
        if progress >= 1.0:
            self._policy_changed_at = None
            return action
        if self._offset is None:
            self._offset = self.latest.action - action
        return action + np.float32(1.0 - smoothstep(np.array(progress))) * self._offset
