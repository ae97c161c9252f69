"""Controller of the live view: simulates one session per robot, and executes requests of web pages."""

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
"""Duration of a push that the user requests on the page, s."""
MAX_EVENTS = 40
"""Maximum number of events (texts about interventions) that are stored until the next state message to the page."""


class ViewController:
    """Simulates robots in real time, and executes the requests of web pages.

    The constructor raises ValueError if a scenario or policy is unknown.

    Args:
        names: Names or paths of policies, one per robot; all robots have the same scenario and seed.
        scenario: Name of the scenario at the start.
        hardware: Robot, motors, sensors and simulator.
        seed: Seed of the first episode.
        command: Fixed velocity command: forward and left velocity, m/s, and yaw rate, rad/s; None for the commands that
            the scenario draws.
        trust: True if policies may be loaded from files that can contain hidden code.

    Attributes:
        paused: True while the simulation is paused.
        sessions: One session per robot.
        orbit: Viewpoint of the camera, which the user moves with the mouse.
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
        self._hardware = hardware
        self._trust = trust
        self._first_scenario = scenario
        self.paused = False
        self._single_step = False
        self._events: deque[str] = deque(maxlen=MAX_EVENTS)
        self._policy_names = tuple(dict.fromkeys((*names, *policies.names(hardware.robot_model))))
        self.sessions: list[Session] = []
        self.orbit = Orbit()
        self._begin(self._resolve_scenario(scenario), names, seed, command)
        self._real_time_rate = RealTimeRate(self.sessions[0].env.dt)
        self._handlers: dict[str, Callable[..., object]] = {
            "steer": lambda forward, left, turn: self._each(lambda robot: robot.steer((forward, left, turn))),
            "let_go": self._release_command,
            "push": self._push,
            "policy": self._choose_policy,
            "alone": lambda: self._restart(self._scenario, self._names[:1]),
            "scenario": lambda name: self._restart(self._resolve_scenario(name), self._names),
            "reset": self._reset,
            "next": self._reset,
            "pause": self._pause,
            "step": self._step_once,
            "speed": lambda factor: setattr(self._real_time_rate, "speed", factor),
            "drag": lambda right, down: self._set_orbit(self.orbit.dragged(right, down)),
            "zoom": lambda wheel: self._set_orbit(self.orbit.zoomed(wheel)),
            "follow": lambda on: self._set_orbit(replace(self.orbit, follow=on)),
        }

    def handle(self, request: Request) -> None:
        """Execute a request of a web page, for example a push or a change of the scenario.

        If the request fails with ValueError, ImportError or OSError, all sessions stay unchanged.
        """
        self._handlers[request.do](**request.values)

    def step(self) -> bool:
        """Wait until the next control step is due in real time, and simulate it for all robots.

        Returns:
            True if a control step was simulated; False if the simulation is paused.
        """
        if self.paused and not self._single_step:
            return False
        if not self._single_step:
            self._real_time_rate.wait()
        self._single_step = False
        self._each(Session.step)
        return True

    def choices(self) -> dict[str, Any]:
        """Return the choices that a page offers to the user.

        Returns:
            Dictionary: `robot`, name of the robot; `policies`, names of the policies; `axes`, list of dictionaries, one
            for each kind of disturbance: its name, the unit of its severity, the severities of its levels, and the
            severity of its default level.
        """
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
        """Return the state message for the pages: scenario, time, command, and telemetry of all robots.

        The message includes the telemetry rows and the events since the last call.
        """
        first = self.sessions[0]
        events = list(self._events)
        self._events.clear()
        return {
            "time": round(first.latest.number * first.env.dt, 3),
            "scenario": self._scenario.name,
            "seed": first.seed,
            "paused": self.paused,
            "speed": self._real_time_rate.speed,
            "measured": round(self._real_time_rate.measured, 3),
            "by_hand": first.command is not None,
            "command": rounded(first.latest.infos["command"][0] if first.command is None else first.command),
            "follow": self.orbit.follow,
            "robots": [telemetry.state() for telemetry in self._telemetry],
            "events": events,
        }

    def render_requests(self) -> list[RenderRequest]:
        """Return one request per robot to draw the robot in its present state."""
        self.orbit = self.orbit.at(self.sessions[0].latest.infos["position"][0])
        return [telemetry.render_request(self.orbit, len(self.sessions)) for telemetry in self._telemetry]

    def close(self) -> None:
        """Close all sessions and free the simulations."""
        self._each(Session.close)

    def _each(self, call: Callable[[Session], object]) -> None:
        """Call the function `call` once for each robot, with its session."""
        for session in self.sessions:
            call(session)

    def _begin(self, scenario: Scenario, names: Sequence[str], seed: int, command: ArrayLike | None) -> None:
        """Replace all sessions by new sessions at the start of an episode.

        The present sessions stay if a policy cannot be loaded.

        Args:
            scenario: Scenario of the episode.
            names: Names or paths of the policies, one per robot.
            seed: Seed of the episode.
            command: Fixed velocity command, as in `Session.steer`; None for the commands that the scenario draws.
        """
        with ExitStack() as stack:
            sessions = []
            for name in names:
                policy = self._hardware.policy(name, self._trust, on_hardware_profile=scenario.hardware)
                session = Session(policy, scenario, seed=seed, command=command, hardware=self._hardware)
                stack.callback(session.close)
                sessions.append(session)
            stack.pop_all()
        self.close()
        self.sessions = sessions
        self._scenario = scenario
        self._names = list(names)
        self._telemetry = [Telemetry(session) for session in sessions]
        sessions[0].listeners.append(self._events.append)
        self._aim_at_start()

    def _restart(self, scenario: Scenario, names: Sequence[str]) -> None:
        """Start an episode with the present seed and command, and with the given scenario and policies."""
        self._begin(scenario, names, self.sessions[0].seed, self.sessions[0].command)
        self._events.append(f"{scenario.name}, {' and '.join(session.policy.name for session in self.sessions)}")

    def _reset(self, seed: int | None = None) -> None:
        """Start a new episode of all robots with the given seed; None means the present seed plus 1."""
        self._each(lambda session: session.reset(seed))
        self._aim_at_start()

    def _release_command(self) -> None:
        """Start the present episode again, with the velocity commands that the scenario draws."""
        self._each(lambda session: session.steer(None))
        self._reset(self.sessions[0].seed)

    def _resolve_scenario(self, name: str) -> Scenario:
        """Return the scenario of a name; raise ValueError if the name is unknown or not allowed.

        A page may not name a scenario file of the user, except for the file with which the view was started.
        """
        if battery.is_file_reference(name) and name != self._first_scenario:
            raise ValueError(f"{name}: a scenario in a file is named when the view is started, with --scenario")
        return battery.resolve_single(name, self._hardware.robot_model)

    def _choose_policy(self, robot: int, name: str) -> None:
        """Change the policy of a robot, or add a robot with the policy.

        If there is only one robot and the policy fits its session, the policy changes during the episode. Otherwise all
        robots start the episode again, so that all robots are at the same time of the same episode.

        Args:
            robot: Index of the robot. An index that equals the number of robots adds a robot.
            name: Name of the policy, one of the choices that the page offers.

        Raises:
            ValueError: The index `robot` is too large, or the policy cannot be used for this robot.
            PolicyError: The page does not offer a policy of this name.
        """
        if robot > len(self.sessions):
            raise ValueError(f"there is no robot {robot}")
        if name not in self._policy_names:
            raise PolicyError(f"no policy {name!r} is offered: there are {', '.join(self._policy_names)}")
        names = [*self._names[:robot], name, *self._names[robot + 1 :]]
        if len(names) == 1:
            # ValueError means that the policy needs another height scan or other servos, and so a new session.
            with suppress(ValueError):
                policy = self._hardware.policy(name, self._trust, on_hardware_profile=self._scenario.hardware)
                self.sessions[0].set_policy(policy)
                self._names = names
                return
        self._restart(self._scenario, names)

    def _push(self, direction: float, impulse: float) -> None:
        """Push the trunks of all robots in the same direction.

        Args:
            direction: Direction of the push as an angle from the first robot's heading, positive to the left, degrees.
            impulse: Impulse of the push, N·s.
        """
        angle = heading_angle(self.sessions[0].latest) + np.radians(direction)
        force = impulse / PUSH_TIME * np.array([np.cos(angle), np.sin(angle)])
        self._each(lambda session: session.push(force, PUSH_TIME))

    def _pause(self, on: bool) -> None:
        """Pause the simulation if `on` is True; otherwise resume it."""
        self.paused = on
        self._real_time_rate.resume()

    def _step_once(self) -> None:
        """Let the next call of `step` simulate one control step, then pause the simulation."""
        self.paused = True
        self._single_step = True

    def _set_orbit(self, orbit: Orbit) -> None:
        """Set the viewpoint of the camera for all robots."""
        self.orbit = orbit

    def _aim_at_start(self) -> None:
        """Aim the camera at the position of the first robot at the start of its episode."""
        self.orbit = replace(self.orbit, target=tuple(self.sessions[0].latest.infos["position"][0].tolist()))
