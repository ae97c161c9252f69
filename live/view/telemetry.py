"""Telemetry of a robot for pages: rows for its curves, a row a control step, its present state, and its picture."""

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
"""The latest rows, as many as the curves of a page show."""


class Telemetry:
    """Observer of a session, from its start on."""

    def __init__(self, session: Session) -> None:
        self._session = session
        self._rows: deque[list[Any]] = deque(maxlen=MAX_ROWS)
        session.observers.append(self)
        self(session.latest)

    def __call__(self, step: Step) -> None:
        """Take note of a control step, or of the start of an episode: only rows of one are kept."""
        if step.number == 0:
            self._rows.clear()
            self._outcome, self._scene = EpisodeOutcome(self._session), Scene(step)
            return
        self._outcome.record()
        self._scene.advance(step)
        self._rows.append(self._row(step))

    def render_request(self, orbit: Orbit, count: int) -> RenderRequest:
        """What is to be drawn of it now, as one of so many robots."""
        simulation, place = self._session.env.simulation, self._session.latest.infos["position"][0]
        name, viewpoint = self._session.policy.name, orbit.for_tile(place, count)
        return RenderRequest(simulation.model, simulation.snapshot(0), name, viewpoint, self._scene.arrows())

    def state(self) -> dict[str, Any]:
        """Present state, with the rows since the last call."""
        infos, policy, rows = self._session.latest.infos, self._session.policy, list(self._rows)
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
        """Time, s; command and velocity: forward m/s, left m/s, turning rad/s; feet on the ground; largest torque as a
        share of what there is; reward of the step."""
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
        return round(float(np.abs(infos["joint_torque"][0]).max()) / self._session.env.robot.rated_torque, 3)


def rounded(values: Any) -> list[float]:
    """Numbers as a page needs them."""
    return [round(float(value), 3) for value in values]


def _correction(policy: Policy) -> float | None:
    """Largest share of its authority that a residual uses of any joint; None of other policies."""
    correction = getattr(policy, "correction", None)
    return None if correction is None else round(float(np.abs(correction).max()), 3)
