"""Collects the telemetry of a robot for the web page of the live view.

The telemetry is the present state of the robot, and a row of numbers per control step for the curves on the page.
"""

from collections import deque
from typing import Any

import numpy as np

from evaluate.film.scene import Scene, heading_angle
from evaluate.rollouts.observers import Step
from live.session import Session
from live.view.outcome import EpisodeOutcome
from live.view.render_request import Orbit, RenderRequest
from policies.base import Policy
from quad_env.task.rewards import REWARD

MAX_ROWS = 600
"""Maximum number of stored telemetry rows, one per control step; the curves on the page have the same length."""


class Telemetry:
    """Observer that collects the telemetry of the robot of a session, for the state messages to the page.

    Args:
        session: Session to observe; the constructor adds this object to the observers of the session.
    """

    def __init__(self, session: Session) -> None:
        self._session = session
        self._rows: deque[list[Any]] = deque(maxlen=MAX_ROWS)
        session.observers.append(self)
        self(session.latest)

    def __call__(self, step: Step) -> None:
        """Record a control step; the start of an episode, step 0, deletes the recorded rows."""
        if step.number == 0:
            self._rows.clear()
            self._outcome = EpisodeOutcome(self._session)
            self._scene = Scene(step)
            return
        self._outcome.record()
        self._scene.advance(step)
        self._rows.append(self._row(step))

    def render_request(self, orbit: Orbit, count: int) -> RenderRequest:
        """Return a request to draw the robot in its present state.

        Args:
            orbit: Viewpoint of the camera.
            count: Number of robots that the image shows side by side.

        Returns:
            Request with a snapshot of the simulation, name of the policy, viewpoint and arrows.
        """
        simulation = self._session.env.simulation
        viewpoint = orbit.for_tile(self._session.latest.infos["position"][0], count)
        return RenderRequest(
            model=simulation.drawn_model,
            data=simulation.drawn_snapshot(0),
            name=self._session.policy.name,
            viewpoint=viewpoint,
            arrows=self._scene.arrows(),
        )

    def state(self) -> dict[str, Any]:
        """Return the present state of the robot for the page, as JSON types.

        Returns:
            Dictionary: name of the policy; outcome of the episode as text; position and height, m; heading and tilt,
            degrees; velocity, m/s and rad/s; largest torque and correction as fractions of their limits. The key `rows`
            has the telemetry rows since the last call.
        """
        infos = self._session.latest.infos
        policy = self._session.policy
        rows = list(self._rows)
        self._rows.clear()
        return {
            "policy": policy.name,
            "outcome": self._outcome.words,
            "failed": self._outcome.failed,
            "story": self._outcome.story[:-1],
            "position": rounded(infos["position"][0]),
            "heading": round(float(np.degrees(heading_angle(self._session.latest))), 1),
            "height": round(float(infos["height"][0]), 3),
            "tilt": round(float(np.degrees(infos["tilt"][0])), 1),
            "velocity": rounded(infos["heading_velocity"][0]),
            "torque": self._torque(infos),
            "correction": _correction(policy),
            "rows": rows,
        }

    def _row(self, step: Step) -> list[Any]:
        """Return the telemetry row of a control step, for the curves on the page.

        Args:
            step: Control step.

        Returns:
            List with six items: time, s; command, and velocity in the heading frame, each with forward m/s, left m/s
            and yaw rate rad/s; contact of each foot, 0 or 1; largest joint torque as a fraction of the rated torque;
            reward of the step.
        """
        infos = step.infos
        return [
            round(step.number * step.env.dt, 4),
            rounded(infos["command"][0]),
            rounded(infos["heading_velocity"][0]),
            [int(contact) for contact in infos["foot_contact"][0]],
            self._torque(infos),
            round(sum(float(values[0]) for name, values in infos.items() if name.startswith(REWARD)), 4),
        ]

    def _torque(self, infos: dict[str, Any]) -> float:
        """Return the largest absolute joint torque, as a fraction of the rated torque of the robot's joints."""
        return round(float(np.abs(infos["joint_torque"][0]).max()) / self._session.env.robot.rated_torque, 3)


def rounded(values: Any) -> list[float]:
    """Convert the numbers in `values` to floats with three decimals, for JSON messages to the page."""
    return [round(float(value), 3) for value in values]


def _correction(policy: Policy) -> float | None:
    """Return the largest present correction of a residual policy, as a fraction of the correction limit (authority).

    None for other policies.
    """
    correction = getattr(policy, "correction", None)
    return None if correction is None else round(float(np.abs(correction).max()), 3)
