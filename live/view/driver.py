"""The driver of the live view: a session, and what can be done with it while it goes on."""

from collections import deque
from collections.abc import Callable, Sequence
from contextlib import ExitStack
from dataclasses import dataclass
from itertools import count
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

import policies
from evaluate.film.scene import heading
from evaluate.rollouts import battery
from evaluate.rollouts.hardware import Hardware
from evaluate.rollouts.observers import Observer
from live.pace import Pace
from live.recording.recorder import Recorder, recorder_for
from live.session import Session
from live.view.camera import Picture, ViewCamera
from live.view.requests import Request
from live.view.telemetry import COLUMNS, Telemetry
from policies.base import Policy, PolicyError
from quad_env.scenarios.axes import axes_of
from quad_env.scenarios.scenario import Scenario

PUSH_TIME = 0.1
"""How long a push by hand lasts, s."""
KEPT_EVENTS = 40
"""The latest events, for a new page."""
COMPANION = "trot"
"""Policy of the second robot, until it is given another."""


@dataclass(frozen=True)
class Start:
    """What the view begins with."""

    policies: Sequence[str]
    """Names or paths, one a robot."""
    scenario: str
    hardware: Hardware
    recordings: Path
    """Folder of the recordings that are begun under way."""
    seed: int = 0
    command: Sequence[float] | None = None
    """Held by hand, forward and left m/s, yaw rate rad/s; None leaves commands to the scenario."""
    trust: bool = False


class Driver:
    """Moves robots on in real time, and does what pages ask for.

    Raises:
        ValueError: there is no such scenario or policy, or policies that do not walk together.
    """

    def __init__(self, start: Start) -> None:
        self._start = start
        self.paused = self._once = False
        self._events: deque[str] = deque(maxlen=KEPT_EVENTS)
        self._recording, self._path, self._required = ExitStack(), "", False
        self._recorder: Recorder | None = None
        self.camera, self._telemetry = ViewCamera(), Telemetry(start.hardware.quadruped.rated_torque)
        self._scenario = self._found(start.scenario)
        self._offered = tuple(dict.fromkeys((*start.policies, *policies.names())))
        self._companion = start.policies[1] if len(start.policies) > 1 else COMPANION
        walkers = [self._policy(name) for name in start.policies]
        self.session = self._begun(self._scenario, walkers, start.seed, start.command)
        self._pace = Pace(self.session.env.dt)
        self._does: dict[str, Callable[..., None]] = {
            "steer": lambda forward, left, turn: self.session.steer((forward, left, turn)),
            "let_go": lambda: self.session.steer(None),
            "push": self._push,
            "policy": self._choose,
            "compare": self._compare,
            "scenario": lambda name: self._begin_with(self._found(name), self.session.policies),
            "reset": self._reset,
            "next": lambda: self._reset(self.session.seed + 1),
            "pause": self._pause,
            "step": self._step_once,
            "speed": lambda factor: setattr(self._pace, "speed", factor),
            "drag": lambda right, down: setattr(self.camera, "orbit", self.camera.orbit.dragged(right, down)),
            "zoom": lambda wheel: setattr(self.camera, "orbit", self.camera.orbit.zoomed(wheel)),
            "follow": self.camera.follow,
            "together": lambda on: setattr(self.camera, "together", on),
            "forces": lambda on: setattr(self.camera, "forces", on),
            "ghost": lambda on: setattr(self.camera, "ghost", on),
            "record": lambda on: self._record(self._free_path()) if on else self._stop_recording(),
        }

    def do(self, request: Request) -> None:
        """Do that. Raises ValueError (PolicyError among them), ImportError or OSError where it cannot be done, and
        nothing has changed then."""
        self._does[request.do](**request.values)

    def move(self) -> bool:
        """Move the robots on by a control step, once it is due; False while paused. OSError where the path of
        `record` cannot be written; a recording that a page began ends then, and the robots walk on."""
        if self.paused and not self._once:
            return False
        if self._once:
            self._once = False
        else:
            self._pace.wait()
        try:
            self.session.step()
        except OSError as error:
            if self._required:
                raise
            self._stop_recording()
            self._events.append(f"the recording has ended: {error}")
        self._telemetry.note(self.session.latest, self.session.policies[0])
        return True

    def picture(self) -> Picture:
        """What there is to be seen now."""
        return self.camera.picture(self.session)

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
        held = session.command
        return {
            "time": round(session.latest.number * session.env.dt, 3),
            "scenario": self._scenario.name,
            "seed": session.seed,
            "paused": self.paused,
            "speed": self._pace.speed,
            "measured": round(self._pace.measured, 3),
            "recording": self._path,
            "by_hand": held is not None,
            "command": [
                round(float(value), 3) for value in (session.latest.infos["command"][0] if held is None else held)
            ],
            "together": camera.together,
            "forces": camera.forces,
            "ghost": camera.ghost,
            "follow": camera.orbit.follow,
            "robots": self._telemetry.robots(session.policies),
            "rows": self._telemetry.rows(),
            "events": events,
        }

    def record(self, path: Path) -> None:
        """Record into that path from now on. Raises as `recorder_for`."""
        self._record(path)
        self._required = True

    def close(self) -> None:
        """Finish the recording and free the simulation. OSError where the recording cannot be finished."""
        try:
            self._stop_recording()
        finally:
            self.session.close()

    def _record(self, path: Path) -> None:
        self._stop_recording()
        with ExitStack() as stack:
            recorder = stack.enter_context(recorder_for(path, self.session.policies[0]))
            stack.callback(lambda: self.session.observers.remove(recorder))
            self.session.observers.append(recorder)
            self._recording, self._recorder = stack.pop_all(), recorder
        self._path, self._required = str(path), False
        self._events.append(f"recording into {path}")

    def _stop_recording(self) -> None:
        path, self._path, self._recorder = self._path, "", None
        self._recording.close()
        if path and Path(path).exists():  # which it does not before the first step
            self._events.append(f"recorded {path}")

    def _begun(self, scenario: Scenario, walkers: Sequence[Policy], seed: int, command: ArrayLike | None) -> Session:
        """A session with its observers."""
        watching: list[Observer] = [self.camera, self._telemetry]
        hardware = self._start.hardware
        session = Session(walkers, scenario, seed=seed, command=command, hardware=hardware, observers=watching)
        session.listeners.append(self._note)
        return session

    def _begin_with(self, scenario: Scenario, walkers: Sequence[Policy]) -> None:
        """The same seed and command on another scenario, or with other robots."""
        before = self.session
        session = self._begun(scenario, walkers, before.seed, before.command)
        others = [observer for observer in before.observers if observer not in session.observers]
        session.observers.extend(others)
        self.session, self._scenario = session, scenario
        before.close()
        session.tell(f"{scenario.name}, {' and '.join(policy.name for policy in walkers)}")
        for observer in others:
            observer(session.latest)

    def _note(self, event: str) -> None:
        """Report an intervention to the page and the recording, such as another first policy."""
        self._events.append(event)
        if self._recorder is not None:
            self._recorder.policy = self.session.policies[0]
            self._recorder.event(event)

    def _found(self, name: str) -> Scenario:
        if battery.of_file(name) and name != self._start.scenario:
            raise ValueError(f"{name}: a scenario in a file is named when the view is started, with --scenario")
        return battery.one(name, self._start.hardware.quadruped)

    def _policy(self, name: str) -> Policy:
        return self._start.hardware.policy(name, self._start.trust)

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

    def _compare(self, on: bool) -> None:
        first = self.session.policies[0]
        if on != (len(self.session.policies) > 1):
            self._begin_with(self._scenario, [first, self._policy(self._companion)] if on else [first])

    def _push(self, direction: float, impulse: float) -> None:
        """Directions are degrees from straight ahead of the first robot to its left."""
        towards = heading(self.session.latest) + np.radians(direction)
        self.session.push(impulse / PUSH_TIME * np.array([np.cos(towards), np.sin(towards)]), PUSH_TIME)

    def _reset(self, seed: int) -> None:
        self.session.reset(seed)

    def _pause(self, on: bool) -> None:
        self.paused = on
        self._pace.resume()

    def _step_once(self) -> None:
        self.paused = self._once = True

    def _free_path(self) -> Path:
        """A file that is not there yet."""
        called = f"{self._scenario.name}-{self.session.policies[0].name}".replace("/", "_").replace(":", "_")
        paths = (self._start.recordings / f"{called}-{number}.mcap" for number in count(1))
        return next(path for path in paths if not path.exists())
