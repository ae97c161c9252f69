"""The driver of the live view: a session, and what can be done with it while it goes on."""

from collections import deque
from collections.abc import Callable, Sequence
from contextlib import ExitStack
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

import policies
from evaluate.film.scene import heading
from evaluate.rollouts import battery
from evaluate.rollouts.hardware import IDEAL, Hardware
from live.recording.recorder import Recorder, recorder_for
from live.session import Session
from live.view.camera import Orbit, ViewCamera
from live.view.requests import Request
from live.view.telemetry import COLUMNS, Telemetry, rounded
from policies.base import Policy, PolicyError
from quad_env.cli.pace import Pace
from quad_env.scenarios.axes import axes_of
from quad_env.scenarios.scenario import Scenario

PUSH_TIME = 0.1
"""How long a push by hand lasts, s."""
KEPT_EVENTS = 40
"""The latest events, for a new page."""
COMPANION = "trot"
"""Policy of the second robot, until it is given another."""


class Driver:
    """Moves robots on in real time, and does what pages ask for.

    Args:
        names: names or paths of policies, one a robot.
        scenario: name of the first.
        command: held by hand, forward and left m/s, yaw rate rad/s; None leaves commands to the scenario.
        trust: as `Hardware.policy` takes it.

    Raises:
        ValueError: there is no such scenario or policy, or policies that do not walk together.
    """

    def __init__(
        self,
        names: Sequence[str],
        scenario: str = "flat",
        hardware: Hardware = IDEAL,
        *,
        seed: int = 0,
        command: Sequence[float] | None = None,
        trust: bool = False,
    ) -> None:
        self._hardware, self._trust, self._first_scenario = hardware, trust, scenario
        self.paused = self._once = False
        self._events: deque[str] = deque(maxlen=KEPT_EVENTS)
        self._recording = ExitStack()
        self._recorder: Recorder | None = None
        self.camera, self._telemetry = ViewCamera(), Telemetry(hardware.quadruped.rated_torque)
        self._scenario = self._found(scenario)
        self._offered = tuple(dict.fromkeys((*names, *policies.names())))
        self._companion, self._names = names[1] if len(names) > 1 else COMPANION, list(names)
        self.session = self._begun(self._scenario, [self._policy(name) for name in names], seed, command)
        self._pace = Pace(self.session.env.dt)
        self._does: dict[str, Callable[..., object]] = {
            "steer": lambda forward, left, turn: self.session.steer((forward, left, turn)),
            "let_go": lambda: self.session.steer(None),
            "push": self._push,
            "policy": self._choose,
            "compare": self._compare,
            "scenario": lambda name: self._go_to(self._found(name)),
            "reset": lambda seed: self.session.reset(seed),
            "next": lambda: self.session.reset(),
            "pause": self._pause,
            "step": self._step_once,
            "speed": lambda factor: setattr(self._pace, "speed", factor),
            "drag": lambda right, down: self._look(self.camera.orbit.dragged(right, down)),
            "zoom": lambda wheel: self._look(self.camera.orbit.zoomed(wheel)),
            "follow": lambda on: self._look(replace(self.camera.orbit, follow=on)),
        }

    def do(self, request: Request) -> None:
        """Do that. Raises ValueError (PolicyError among them), ImportError or OSError where it cannot be done, and
        nothing has changed then."""
        self._does[request.do](**request.values)

    def move(self) -> bool:
        """Move the robots on by a control step, once it is due; False while paused. OSError where the path of
        `record` cannot be written."""
        if self.paused and not self._once:
            return False
        if not self._once:
            self._pace.wait()
        self._once = False
        self.session.step()
        self._telemetry.note(self.session)
        return True

    def offer(self) -> dict[str, Any]:
        """Choices of a page: names of policies and axes of scenarios; the robot, and the columns of rows."""
        return {
            "robot": self.session.env.robot.name,
            "policies": self._offered,
            "axes": [
                {"name": axis.name, "unit": axis.unit, "levels": list(axis.levels), "nominal": axis.nominal}
                for axis in axes_of(self.session.env.robot).values()
            ],
            "columns": COLUMNS,
        }

    def state(self) -> dict[str, Any]:
        """Present state, with rows and events since the last call."""
        session, camera, events = self.session, self.camera, list(self._events)
        self._events.clear()
        return {
            "time": round(session.latest.number * session.env.dt, 3),
            "scenario": self._scenario.name,
            "seed": session.seed,
            "paused": self.paused,
            "speed": self._pace.speed,
            "measured": round(self._pace.measured, 3),
            "by_hand": session.command is not None,
            "command": rounded(session.latest.infos["command"][0] if session.command is None else session.command),
            "follow": camera.orbit.follow,
            "robots": self._telemetry.robots(session),
            "rows": self._telemetry.rows(),
            "events": events,
        }

    def record(self, path: Path) -> None:
        """Record into that path from now on. Raises as `recorder_for`."""
        self._recorder = self._recording.enter_context(recorder_for(path, self.session.policies[0]))
        self.session.observers.append(self._recorder)

    def close(self) -> None:
        """Finish the recording and free the simulation. OSError where the recording cannot be finished."""
        try:
            self._recording.close()
        finally:
            self.session.close()

    def _begun(self, scenario: Scenario, walkers: Sequence[Policy], seed: int, command: ArrayLike | None) -> Session:
        """A session with its observers."""
        hardware = self._hardware
        session = Session(walkers, scenario, seed=seed, command=command, hardware=hardware, observers=[self.camera])
        session.listeners.append(self._note)
        return session

    def _begin_with(self, scenario: Scenario, walkers: Sequence[Policy]) -> None:
        """The same seed and command on another scenario, or with other robots."""
        before = self.session
        session = self._begun(scenario, walkers, before.seed, before.command)
        self.session, self._scenario = session, scenario
        before.close()
        session.tell(f"{scenario.name}, {' and '.join(policy.name for policy in walkers)}")
        if self._recorder is not None:
            session.observers.append(self._recorder)
            self._recorder(session.latest)

    def _note(self, event: str) -> None:
        """Report an intervention to the page and the recording, such as another first policy."""
        self._events.append(event)
        if self._recorder is not None:
            self._recorder.policy = self.session.policies[0]
            self._recorder.event(event)

    def _found(self, name: str) -> Scenario:
        if battery.of_file(name) and name != self._first_scenario:
            raise ValueError(f"{name}: a scenario in a file is named when the view is started, with --scenario")
        return battery.one(name, self._hardware.quadruped)

    def _policy(self, name: str) -> Policy:
        return self._hardware.policy(name, self._trust, real=self._scenario.hardware)

    def _go_to(self, scenario: Scenario) -> None:
        """On to another scenario; with the hardware profile, or without, policies are made for it."""
        walkers = self.session.policies
        if scenario.hardware != self._scenario.hardware:
            walkers = [self._hardware.policy(name, self._trust, real=scenario.hardware) for name in self._names]
        self._begin_with(scenario, walkers)

    def _choose(self, robot: int, name: str) -> None:
        if robot >= len(self.session.policies):
            raise ValueError(f"there is no robot {robot + 1}")
        if name not in self._offered:
            raise PolicyError(f"no policy {name!r} is offered: there are {', '.join(self._offered)}")
        policy = self._policy(name)
        if len(self.session.policies) == 1 and policy.height_scan != self.session.policies[0].height_scan:
            self._begin_with(self._scenario, [policy])  # only a session from its start shows it the ground
        else:
            self.session.choose(robot, policy)
        self._names[robot] = name

    def _compare(self, on: bool) -> None:
        first = self.session.policies[0]
        if on != (len(self.session.policies) > 1):
            self._begin_with(self._scenario, [first, self._policy(self._companion)] if on else [first])
            self._names[1:] = [self._companion] if on else []

    def _push(self, direction: float, impulse: float) -> None:
        """Directions are degrees from straight ahead of the first robot to its left."""
        towards = heading(self.session.latest) + np.radians(direction)
        self.session.push(impulse / PUSH_TIME * np.array([np.cos(towards), np.sin(towards)]), PUSH_TIME)

    def _look(self, orbit: Orbit) -> None:
        self.camera.orbit = orbit

    def _pause(self, on: bool) -> None:
        self.paused = on
        self._pace.resume()

    def _step_once(self) -> None:
        self.paused = self._once = True
