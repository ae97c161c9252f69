"""Telemetry for pages: rows for curves, a row a control step, and the present state of each robot."""

from collections import deque
from typing import Any

import numpy as np

from evaluate.film.scene import headings
from evaluate.rollouts.observers import Step
from live.outcome import OutcomeSoFar
from live.session import failure_of
from policies.base import Policy
from quad_env.config import FALL_REASONS
from quad_env.task.rewards import REWARD

COLUMNS = ("time", "command", "velocity", "contacts", "torque", "reward", "correction")
"""Of a row of the first robot: s; forward m/s, left m/s, turning rad/s, as commanded and as they were; feet on the
ground; largest torque and correction as shares of what there is, and the step's reward."""

KEPT_ROWS = 600
"""The latest rows, as many as the curves of a page show."""


class Telemetry:
    """Observer that keeps the rows of the first robot until they are sent."""

    def __init__(self, torque_limit: float) -> None:
        self._torque_limit = torque_limit
        self._rows: deque[list[Any]] = deque(maxlen=KEPT_ROWS)
        self._outcome = OutcomeSoFar()

    def __call__(self, step: Step) -> None:
        """Take note of a control step, or of the start of an episode."""
        self._outcome(step)
        self._step = step
        if step.number == 0:
            self._rows.clear()

    def note(self, step: Step, policy: Policy) -> None:
        """Keep the row of a control step."""
        infos = step.infos
        row = [
            round(step.number * step.env.dt, 4),
            _rounded(infos["command"][0]),
            _rounded(infos["heading_velocity"][0]),
            [int(contact) for contact in infos["foot_contact"][0]],
            round(float(np.abs(infos["joint_torque"][0]).max()) / self._torque_limit, 3),
            round(sum(float(values[0]) for name, values in infos.items() if name.startswith(REWARD)), 4),
            _correction(policy),
        ]
        self._rows.append(row)

    def rows(self) -> list[list[Any]]:
        """Those since the last call."""
        rows = list(self._rows)
        self._rows.clear()
        return rows

    def robots(self, policies: list[Policy]) -> list[dict[str, Any]]:
        """Present state of each robot."""
        infos, outcomes = self._step.infos, self._outcome.words()
        heading = np.degrees(headings(self._step))
        return [
            {
                "policy": policy.name,
                "outcome": outcomes[number],
                "fall": FALL_REASONS[infos["fall"][number]] if infos["fall"][number] else "",
                "position": _rounded(infos["position"][number]),
                "heading": round(float(heading[number]), 1),
                "height": round(float(infos["height"][number]), 3),
                "tilt": round(float(np.degrees(infos["tilt"][number])), 1),
                "velocity": _rounded(infos["heading_velocity"][number]),
                "torque": round(float(np.abs(infos["joint_torque"][number]).max()) / self._torque_limit, 3),
                "correction": _correction(policy),
                "failure": failure_of(policy),
                "rewards": {
                    name.removeprefix(REWARD): round(float(values[number]), 4)
                    for name, values in infos.items()
                    if name.startswith(REWARD)
                },
            }
            for number, policy in enumerate(policies)
        ]


def _rounded(values: Any) -> list[float]:
    return [round(float(value), 3) for value in values]


def _correction(policy: Policy) -> float | None:
    """Largest share of its authority that a residual uses of any joint; None of other policies."""
    correction = getattr(policy, "correction", None)
    return None if correction is None else round(float(np.abs(correction).max()), 3)
