"""Telemetry for pages: rows for curves, a row a control step, and the present state of each robot."""

from collections import deque
from typing import Any

import numpy as np

from evaluate.film.scene import headings
from live.session import Session
from policies.base import Policy
from quad_env.config import FALL_REASONS
from quad_env.task.rewards import REWARD

COLUMNS = ("time", "command", "velocity", "contacts", "torque", "reward", "correction")
"""Of a row of the first robot: s; forward m/s, left m/s, turning rad/s, as commanded and as they were; feet on the
ground; largest torque and correction as shares of what there is, and the step's reward."""

KEPT_ROWS = 600
"""The latest rows, as many as the curves of a page show."""


class Telemetry:
    """Keeps the rows of the first robot until they are sent."""

    def __init__(self, torque_limit: float) -> None:
        self._torque_limit = torque_limit
        self._rows: deque[list[Any]] = deque(maxlen=KEPT_ROWS)

    def note(self, session: Session) -> None:
        """Keep the row of the control step just taken; only those of one episode are kept."""
        step, infos = session.latest, session.latest.infos
        if step.number == 1:
            self._rows.clear()
        row = [
            round(step.number * step.env.dt, 4),
            rounded(infos["command"][0]),
            rounded(infos["heading_velocity"][0]),
            [int(contact) for contact in infos["foot_contact"][0]],
            round(float(np.abs(infos["joint_torque"][0]).max()) / self._torque_limit, 3),
            round(sum(float(values[0]) for name, values in infos.items() if name.startswith(REWARD)), 4),
            _correction(session.policies[0]),
        ]
        self._rows.append(row)

    def rows(self) -> list[list[Any]]:
        """Those since the last call."""
        rows = list(self._rows)
        self._rows.clear()
        return rows

    def robots(self, session: Session) -> list[dict[str, Any]]:
        """Present state of each robot."""
        infos, heading = session.latest.infos, np.degrees(headings(session.latest))
        return [
            {
                "policy": policy.name,
                "state": _state(infos["fall"][number], infos["diverged"][number]),
                "position": rounded(infos["position"][number]),
                "heading": round(float(heading[number]), 1),
                "height": round(float(infos["height"][number]), 3),
                "tilt": round(float(np.degrees(infos["tilt"][number])), 1),
                "velocity": rounded(infos["heading_velocity"][number]),
                "torque": round(float(np.abs(infos["joint_torque"][number]).max()) / self._torque_limit, 3),
                "correction": _correction(policy),
                "failure": (getattr(policy, "failure", None) or [None])[0] or "",
                "rewards": {
                    name.removeprefix(REWARD): round(float(values[number]), 4)
                    for name, values in infos.items()
                    if name.startswith(REWARD)
                },
            }
            for number, policy in enumerate(session.policies)
        ]


def _state(fall: int, diverged: bool) -> str:
    if diverged:
        return "diverged"
    return f"fell: {FALL_REASONS[fall]}" if fall else "upright"


def rounded(values: Any) -> list[float]:
    """Numbers as a page needs them."""
    return [round(float(value), 3) for value in values]


def _correction(policy: Policy) -> float | None:
    """Largest share of its authority that a residual uses of any joint; None of other policies."""
    correction = getattr(policy, "correction", None)
    return None if correction is None else round(float(np.abs(correction).max()), 3)
