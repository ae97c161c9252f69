"""Session: robots of one episode, a policy each, that a person steers and pushes while they walk."""

from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import ArrayLike, NDArray

from evaluate.rollouts.hardware import IDEAL, Hardware
from evaluate.rollouts.observers import Observer, Step
from evaluate.rollouts.rollout import advance, batch_of, begin
from policies.base import Actions, Policy, PolicyError
from policies.gait_cycle import smoothstep
from quad_env.scenarios.scenario import Scenario

CHANGE = 0.4
"""Time in which the joint targets pass from where they were into those of a policy that is chosen, s."""


class Session:
    """n robots with the same start, ground, pushes and commands, without a time limit.

    A fallen robot goes on. Commands and pushes are the scenario's until `steer` and `push`. Observers get the start of
    every episode, as step 0, and every control step after it; listeners get a few words about every intervention:
    `reset, seed 4`, `trot chosen`.

    Args:
        policies: one for each robot; no two share an object.
        seed: of the first episode, for every robot.
        command: held from the first step on, as by `steer`.

    Raises:
        ValueError: no policy, or one that was made for another robot or another control period.
        PolicyError: policies with different observations.
    """

    def __init__(
        self,
        policies: Sequence[Policy],
        scenario: str | Scenario = "flat",
        *,
        seed: int = 0,
        command: ArrayLike | None = None,
        hardware: Hardware = IDEAL,
        observers: Sequence[Observer] = (),
    ) -> None:
        if not policies:
            raise ValueError("a session needs a policy for each robot, and at least one")
        self.env = batch_of(
            policies[0],
            scenario,
            len(policies),
            steps=None,
            nthread=1,
            terminate_on_fall=False,
            hardware=hardware,
        )
        self.policies = list(policies)
        """Policy of each robot."""
        self.observers = list(observers)
        self.listeners: list[Callable[[str], None]] = []
        self.command = None if command is None else np.asarray(command, np.float64)
        """Command that is held, (3,); None where the scenario draws them."""
        self.seed = seed
        """Of the present episode."""
        self._chosen_at: dict[int, int] = {}
        self._offset: dict[int, Actions] = {}
        try:
            for policy in policies:
                self._check(policy)
            self._begin()
        except BaseException:
            self.close()
            raise

    def reset(self, seed: int | None = None) -> Step:
        """Start an episode, by default that of the next seed; a command that was given stays."""
        self.seed = self.seed + 1 if seed is None else seed
        self.tell(f"reset, seed {self.seed}")
        return self._begin()

    def step(self) -> Step:
        """Move all robots on by a control step."""
        observation = self.latest.observation
        action = np.concatenate([self._action(robot, observation[[robot]]) for robot in range(len(self.policies))])
        return self._show(advance(self.latest, action)[0])

    def steer(self, command: ArrayLike | None) -> None:
        """Have all robots follow this command, (3,): forward and left m/s, heading frame, yaw rate rad/s.

        None gives the commands back to the scenario, from the next episode on. ValueError for what is no command.
        """
        if command is not None:
            self.env.steer(command)
        self.command = None if command is None else np.asarray(command, np.float64)

    def push(self, force: ArrayLike, duration: float) -> None:
        """Push all trunks, with (2,) N, world frame, for a duration, s. ValueError for what is no push."""
        self.env.push(force, duration)
        forward, left = np.asarray(force, np.float64)
        self.tell(f"pushed by hand, {np.hypot(forward, left) * duration:.3g} N·s")

    def choose(self, robot: int, policy: Policy) -> None:
        """Replace the policy of that robot; joint targets change over within `CHANGE`. Raises as the constructor, and
        nothing has changed then."""
        self._check(policy)
        policy.reset(num_envs=1, seed=0)
        self.policies[robot], self._chosen_at[robot] = policy, self.latest.number
        self._offset.pop(robot, None)
        self.tell(f"{policy.name} chosen")

    def tell(self, event: str) -> None:
        """Send an event to the listeners."""
        for listener in self.listeners:
            listener(event)

    def close(self) -> None:
        """Free the simulation."""
        self.env.close()

    def _check(self, policy: Policy) -> None:
        policy.check_fits(self.env.robot, self.env.dt)
        if policy.height_scan != self.policies[0].height_scan:
            raise PolicyError(f"{policy.name} needs other ground heights than {self.policies[0].name}")

    def _begin(self) -> Step:
        self._chosen_at.clear()
        self._offset.clear()
        for policy in self.policies:
            policy.reset(num_envs=1, seed=0)
        return self._show(begin(self.env, np.full(len(self.policies), self.seed), self.command))

    def _show(self, step: Step) -> Step:
        self.latest = step
        for observer in self.observers:
            observer(step)
        return step

    def _action(self, robot: int, observation: NDArray[np.float32]) -> Actions:
        action = self.policies[robot].act(observation)
        if robot not in self._chosen_at:
            return action
        passed = (self.latest.number - self._chosen_at[robot]) * self.env.dt / CHANGE
        if passed >= 1.0:
            del self._chosen_at[robot]
            return action
        offset = self._offset.setdefault(robot, self.latest.action[[robot]] - action)
        return action + np.float32(1.0 - smoothstep(np.array(passed))) * offset
