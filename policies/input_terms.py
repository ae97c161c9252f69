"""Network inputs that consist of observation terms, each with its last values at the rate of the policy.

The inputs are a plain concatenation, which the deployment runtimes of robots can compute: one term after the other, and
the last values of each term from the oldest to the newest. Isaac Lab and mjlab stack histories in the same order.
"""

from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from policies.history import MAX_AGE, Frames, History, Inputs, TermName
from policies.memory import PerRobotState
from quad_env.robots.robot import Robot
from quad_env.task.observations import observation_table

DEPLOYABLE_TERMS: tuple[TermName, ...] = (
    "angular_velocity", "projected_gravity", "command", "joint_position", "joint_velocity", "previous_action",
)  # fmt: skip
"""Names of the observation terms that the sensors and the computer of a robot provide without a velocity estimator.

These are the gyroscope, the orientation of the IMU, the encoders, and the policy's own command and action."""
GAIT_PHASE = "gait_phase"
"""Name of the term with sine and cosine of the clock in `TermInputs.layout`."""
ORDER = "oldest first"
"""Order of the last values of a term in the network inputs."""


@dataclass(frozen=True)
class InputTerm:
    """Term of the network inputs: its last values, multiplied by its scale."""

    name: str
    width: int
    """Number of components of one value."""
    scale: float
    """Factor on every component."""
    history: int
    """Number of last values, from the oldest to the newest."""
    columns: tuple[int, int]
    """First column of the term in the network inputs, and the column after its last one."""


class TermInputs(PerRobotState):
    """Network inputs of n robots: the last values of observation terms, and of a clock.

    A value is added for each action of the policy, every `hold` control steps. The first value after a reset also
    stands for all values before the reset. `update` is called in every control step. Its result between two actions has
    the newest observation, and past values at the same intervals.

    Args:
        robot: Robot that defines the layout of the observation.
        inputs: Names of the terms, number of values, and clock.
        hold: Number of control steps for which the policy holds each action.
        control_period: Time between two calls of `update`, s.

    Raises:
        ValueError: The history is longer than `MAX_AGE`.
    """

    def __init__(self, robot: Robot, inputs: Inputs, hold: int, control_period: float) -> None:
        table = observation_table(robot)
        slices = [table.slices[name] for name in inputs.terms]
        self._observed = np.concatenate([np.arange(part.start, part.stop) for part in slices])
        """Columns of the terms in the observation, (number of observed components,)."""
        self._scale = table.scale[self._observed]
        self.period = hold * control_period
        """Time between two values of a term, s."""
        ages = [age * self.period for age in range(inputs.history - 1, 0, -1)]
        if ages and ages[0] > MAX_AGE:
            fact = f"{inputs.history} values at intervals of {self.period:g} s cover too long a time"
            raise ValueError(f"Inputs.history: {fact}, got {ages[0]:g} s; valid: at most {MAX_AGE:g} s")
        self.layout = _layout(robot, inputs)
        """Terms of the network inputs, in order."""
        self._frame_width = sum(term.width for term in self.layout)
        self.width = self._frame_width * inputs.history
        """Number of network inputs of one robot."""
        self._order = _term_order([term.width for term in self.layout], inputs.history)
        self._past = History(Inputs(lags=tuple(ages)), self._frame_width, control_period)
        super().__init__()

    def update(self, observation: NDArray[np.float32], clock: Frames | None) -> Frames:
        """Compute the network inputs of all robots for one control step. Call the method once per control step.

        Args:
            observation: Observation of all robots, (n, k), with k numbers per robot.
            clock: Sine and cosine of the clock, (n, 2); None if there is no clock.

        Returns:
            Network inputs, (n, `width`).
        """
        values = np.empty((len(observation), self.width), np.float32)
        past = self.width - self._frame_width
        frame = values[:, past:]
        np.multiply(observation.take(self._observed, axis=1), self._scale, out=frame[:, : len(self._observed)])
        if clock is not None:
            frame[:, len(self._observed) :] = clock
        self._past.update(frame, out=values[:, :past])
        return values.take(self._order, axis=1)

    def describe(self, inputs: Inputs, control_period: float) -> dict[str, Any]:
        """Describe the network inputs for `policy.json`, so that a program can compute them without this project.

        Args:
            inputs: Settings from which the object was made.
            control_period: Control period, s.

        Returns:
            Field name -> JSON value. `gait_phase` has the frequency of the clock, Hz, its phase at the first action,
            rad, and its value at rest; it is None without a clock.
        """
        clock = None
        if inputs.clock:
            start = 2.0 * np.pi * inputs.clock * control_period
            clock = {"frequency": inputs.clock, "start": start, "at_rest": inputs.clock_at_rest}
        terms = [asdict(term) | {"columns": list(term.columns)} for term in self.layout]
        return {"order": ORDER, "period": self.period, "terms": terms, GAIT_PHASE: clock}


def _layout(robot: Robot, inputs: Inputs) -> tuple[InputTerm, ...]:
    """Return the terms of the network inputs of a `robot`, in order; the clock of `inputs` is the last term."""
    known = {term.name: (term.width, term.scale) for term in observation_table(robot).terms}
    entries: list[tuple[str, int, float]] = [(name, *known[name]) for name in inputs.terms]
    if inputs.clock:
        entries.append((GAIT_PHASE, 2, 1.0))
    layout: list[InputTerm] = []
    start = 0
    for name, width, scale in entries:
        stop = start + width * inputs.history
        layout.append(InputTerm(name, width, scale, inputs.history, (start, stop)))
        start = stop
    return tuple(layout)


def _term_order(widths: list[int], history: int) -> NDArray[np.intp]:
    """Return the indices that sort concatenated frames by term.

    Args:
        widths: Number of components of each term in a frame.
        history: Number of frames.

    Returns:
        For each network input: its index in the concatenated frames, (history * sum of the widths,).
    """
    frames = np.arange(history * sum(widths)).reshape(history, -1)
    ends = np.cumsum(widths)[:-1]
    return np.concatenate([part.ravel() for part in np.split(frames, ends, axis=1)])
