"""The driver of the live view: sessions side by side, and what can be done with them while they go on."""

from collections import deque
from collections.abc import Callable, Sequence
from contextlib import ExitStack, suppress
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

import policies
from evaluate.film.scene import heading_angle
from evaluate.hardware import IDEAL, HardwareConfig
from evaluate.rollouts import battery
from live.session import Session
from live.view.render_request import Orbit, RenderRequest
from live.view.requests import Request
from live.view.telemetry import Telemetry, rounded
from policies.base import PolicyError
from quad_env.cli.real_time_rate import RealTimeRate
from quad_env.scenarios.axes import axes_of
from quad_env.scenarios.scenario import Scenario

PUSH_TIME = 0.1
"""How long a push by hand lasts, s."""
MAX_EVENTS = 40
"""The latest events, for a new page."""


class ViewController:
    """Moves robots on in real time, and does what pages ask for.

    Args:
        names: names or paths of policies, one a robot; all robots have the same episode.
        scenario: name of the first.
        command: held by hand, forward and left m/s, yaw rate rad/s; None leaves commands to the scenario.
        trust: as `Hardware.policy` takes it.

    Raises:
        ValueError: there is no such scenario or policy.
    """

    def __init__(
        self,
        names: Sequence[str],
        scenario: str = "flat",
        hardware: HardwareConfig = IDEAL,
        *,
        seed: int = 0,
        command: Sequence[float] | None = None,
        trust: bool = False,
    ) -> None:
        self._hardware, self._trust, self._first_scenario = hardware, trust, scenario
        self.paused = self._single_step = False
        self._events: deque[str] = deque(maxlen=MAX_EVENTS)
        self._policy_names = tuple(dict.fromkeys((*names, *policies.names())))
        self.sessions: list[Session] = []
        """One a robot."""
        self.orbit = Orbit()
        self._begin(self._resolve_scenario(scenario), names, seed, command)
        self._pace = RealTimeRate(self.sessions[0].env.dt)
        self._handlers: dict[str, Callable[..., object]] = {
            "steer": lambda forward, left, turn: self._each(lambda robot: robot.steer((forward, left, turn))),
            "let_go": self._release_command,
            "push": self._push,
            "policy": self._choose,
            "alone": lambda: self._begin_again(self._scenario, self._names[:1]),
            "scenario": lambda name: self._begin_again(self._resolve_scenario(name), self._names),
            "reset": self._reset,
            "next": self._reset,
            "pause": self._pause,
            "step": self._step_once,
            "speed": lambda factor: setattr(self._pace, "speed", factor),
            "drag": lambda right, down: self._look(self.orbit.dragged(right, down)),
            "zoom": lambda wheel: self._look(self.orbit.zoomed(wheel)),
            "follow": lambda on: self._look(replace(self.orbit, follow=on)),
        }

    def handle(self, request: Request) -> None:
        """Do that. Raises ValueError (PolicyError among them), ImportError or OSError where it cannot be done, and
        nothing has changed then."""
        self._handlers[request.do](**request.values)

    def step(self) -> bool:
        """Move the robots on by a control step, once it is due; False while paused."""
        if self.paused and not self._single_step:
            return False
        if not self._single_step:
            self._pace.wait()
        self._single_step = False
        self._each(Session.step)
        return True

    def choices(self) -> dict[str, Any]:
        """Choices of a page: names of policies and axes of scenarios; the robot."""
        robot = self.sessions[0].env.robot
        return {
            "robot": robot.name,
            "policies": self._policy_names,
            "axes": [
                {"name": axis.name, "unit": axis.unit, "levels": list(axis.levels), "nominal": axis.nominal}
                for axis in axes_of(robot).values()
            ],
        }

    def state(self) -> dict[str, Any]:
        """Present state, with rows and events since the last call."""
        first, events = self.sessions[0], list(self._events)
        self._events.clear()
        return {
            "time": round(first.latest.number * first.env.dt, 3),
            "scenario": self._scenario.name,
            "seed": first.seed,
            "paused": self.paused,
            "speed": self._pace.speed,
            "measured": round(self._pace.measured, 3),
            "by_hand": first.command is not None,
            "command": rounded(first.latest.infos["command"][0] if first.command is None else first.command),
            "follow": self.orbit.follow,
            "robots": [telemetry.state() for telemetry in self._telemetry],
            "events": events,
        }

    def render_requests(self) -> list[RenderRequest]:
        """Every robot now, side by side."""
        self.orbit = self.orbit.at(self.sessions[0].latest.infos["position"][0])
        return [telemetry.render_request(self.orbit, len(self.sessions)) for telemetry in self._telemetry]

    def close(self) -> None:
        """Free the simulations."""
        self._each(Session.close)

    def _each(self, do: Callable[[Session], object]) -> None:
        for session in self.sessions:
            do(session)

    def _begin(self, scenario: Scenario, names: Sequence[str], seed: int, command: ArrayLike | None) -> None:
        """An episode with these policies; nothing has changed where one of them cannot be had."""
        with ExitStack() as stack:
            sessions = []
            for name in names:
                policy = self._hardware.policy(name, self._trust, on_hardware_profile=scenario.hardware)
                session = Session(policy, scenario, seed=seed, command=command, hardware=self._hardware)
                stack.callback(session.close)
                sessions.append(session)
            stack.pop_all()
        self.close()
        self.sessions, self._scenario, self._names = sessions, scenario, list(names)
        self._telemetry = [Telemetry(session) for session in sessions]
        sessions[0].listeners.append(self._events.append)
        self._look_at_start()

    def _begin_again(self, scenario: Scenario, names: Sequence[str]) -> None:
        """The same seed and command on another scenario, or with other robots."""
        self._begin(scenario, names, self.sessions[0].seed, self.sessions[0].command)
        self._events.append(f"{scenario.name}, {' and '.join(session.policy.name for session in self.sessions)}")

    def _reset(self, seed: int | None = None) -> None:
        self._each(lambda session: session.reset(seed))
        self._look_at_start()

    def _release_command(self) -> None:
        """The episode again, with the commands of its scenario."""
        self._each(lambda session: session.steer(None))
        self._reset(self.sessions[0].seed)

    def _resolve_scenario(self, name: str) -> Scenario:
        if battery.is_file_reference(name) and name != self._first_scenario:
            raise ValueError(f"{name}: a scenario in a file is named when the view is started, with --scenario")
        return battery.resolve_single(name, self._hardware.robot_model)

    def _choose(self, robot: int, name: str) -> None:
        """A robot alone changes its policy under way where that can be; else, also for a further robot, all begin their
        episode again, so that each has the same."""
        if robot > len(self.sessions):
            raise ValueError(f"there is no robot {robot}")
        if name not in self._policy_names:
            raise PolicyError(f"no policy {name!r} is offered: there are {', '.join(self._policy_names)}")
        names = [*self._names[:robot], name, *self._names[robot + 1 :]]
        if len(names) == 1:
            with suppress(ValueError):  # other ground heights or servos: only a session from its start has them
                self.sessions[0].set_policy(
                    self._hardware.policy(name, self._trust, on_hardware_profile=self._scenario.hardware)
                )
                self._names = names
                return
        self._begin_again(self._scenario, names)

    def _push(self, direction: float, impulse: float) -> None:
        """Directions are degrees from straight ahead of the first robot to its left."""
        towards = heading_angle(self.sessions[0].latest) + np.radians(direction)
        force = impulse / PUSH_TIME * np.array([np.cos(towards), np.sin(towards)])
        self._each(lambda session: session.push(force, PUSH_TIME))

    def _pause(self, on: bool) -> None:
        self.paused = on
        self._pace.resume()

    def _step_once(self) -> None:
        self.paused = self._single_step = True

    def _look(self, orbit: Orbit) -> None:
        self.orbit = orbit

    def _look_at_start(self) -> None:
        self.orbit = replace(self.orbit, target=tuple(self.sessions[0].latest.infos["position"][0].tolist()))
