"""Gaits on flat ground, recorded in every control step: contacts, velocity, targets, and derived measures."""

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from evaluate.rollouts.observers import FallRecorder, Observer, Step
from evaluate.rollouts.rollout import roll_out
from policies.base import CONTROL_PERIOD, Floats
from policies.gait_cycle import TURN
from policies.gaits.policy import Gaits

TARGET_RATE_LIMIT = 25.0
"""rad/s. Largest rate of a joint target, within a gait and between two gaits."""
Contacts = NDArray[np.bool_]


@dataclass(frozen=True)
class Strides:
    """Recorded steps of n robots; entries after a fall are meaningless."""

    commanded: Contacts
    """Commanded contacts of the feet, (steps, n, 4)."""
    measured: Contacts
    """Measured contacts of the feet, (steps, n, 4)."""
    phase: Floats
    """Phase of the policy's clock, rad, (steps, n)."""
    duty: Floats
    """Duty factor in use, (steps, n)."""
    clock_rate: Floats
    """Clock rate in use, cycles/s, (steps, n)."""
    offsets: Floats
    """Phase offsets in use, rad, (steps, n, 4)."""
    heading_velocity: Floats
    """Forward and lateral velocity, m/s, and yaw rate, rad/s, heading frame, (steps, n, 3)."""
    targets: Floats
    """Joint targets, rad, (steps, n, 12)."""
    fell: NDArray[np.bool_]
    """True for robots that fell, (n,)."""

    @property
    def target_rate(self) -> Floats:
        """Largest rate of any joint target of each robot, rad/s, (n,)."""
        return np.asarray(np.abs(np.diff(self.targets, axis=0)).max(axis=(0, 2)) / CONTROL_PERIOD)

    def since(self, step: int) -> "Strides":
        """Return the record from a control step on."""
        return replace(self, **{name: value[step:] for name, value in vars(self).items() if name != "fell"})

    def of(self, robots: NDArray[np.bool_]) -> "Strides":
        """Return the record of some robots, (n,) bool."""
        theirs = {name: value[:, robots] for name, value in vars(self).items() if name != "fell"}
        return Strides(**theirs, fell=self.fell[robots])

    def duty_errors(self) -> Floats:
        """Return measured minus commanded duty factor of each foot, (n, 4)."""
        return np.asarray(duty_factors(self.measured) - self.duty.mean(axis=0)[:, None])

    def offset_errors(self) -> Floats:
        """Return the phase error of each foot relative to the first, cycles, (n, 4); nan if a foot never landed."""
        cycles = (self.phase[..., None] + self.offsets) % TURN / TURN
        landed = landings(self.measured, cycles, self.duty)
        commanded = (self.offsets[-1] - self.offsets[-1][:, :1]) / TURN
        return wrapped(landing_offsets(landed, self.phase) - commanded)


def walked(
    policy: Gaits, command: Floats, seeds: NDArray[np.int64], *observers: Observer, steps: int, nthread: int = 1
) -> Strides:
    """Run an episode of `policy` on flat ground for each seed, at constant commands (3,) or (n, 3)."""
    recorder = _StrideRecorder(policy, FallRecorder(len(seeds), steps))
    roll_out(policy, "flat", seeds, recorder, *observers, steps=steps, nthread=nthread, command=command)
    return recorder.strides()


class _StrideRecorder:
    """Observer that records `Strides`."""

    def __init__(self, policy: Gaits, falls: FallRecorder) -> None:
        self._policy, self._falls = policy, falls
        self._record: list[dict[str, NDArray[Any]]] = []

    def __call__(self, step: Step) -> None:
        if not step.number:
            return
        self._falls(step)
        policy = self._policy
        entries = {
            "commanded": ~policy.swing,
            "measured": step.infos["foot_contact"],
            "phase": policy.phase,
            "duty": policy.duty,
            "clock_rate": policy.clock_rate,
            "offsets": policy.offsets,
            "heading_velocity": step.infos["heading_velocity"],
            "targets": step.action.astype(np.float64),
        }
        self._record.append(entries)

    def strides(self) -> Strides:
        """Return the complete record."""
        arrays: dict[str, Any] = {name: np.array([each[name] for each in self._record]) for name in self._record[0]}
        return Strides(**arrays, fell=self._falls.fell)


def duty_factors(contacts: Contacts) -> Floats:
    """Return the share of time that each foot is in contact, (..., 4), from contacts (steps, ..., 4)."""
    shares: Floats = contacts.mean(axis=0)
    return shares


def landings(contacts: Contacts, cycles: Floats, duty: Floats) -> Contacts:
    """Return the control steps at which feet land, (steps, ..., 4).

    A landing is the first contact after a foot was in the air in the second half of its swing. A bounce within the
    stance is therefore no landing. `cycles` is the position of each leg in its cycle, from 0 at the start of its swing
    up to 1, (steps, ..., 4). `duty` is the duty factor, (steps, ...).
    """
    swing_share = 1.0 - duty[..., None]
    late = (cycles >= 0.5 * swing_share) & (cycles < swing_share)
    flying = np.zeros(contacts.shape[1:], np.bool_)
    landed = np.zeros_like(contacts)
    for step, contact in enumerate(contacts):
        landed[step] = flying & contact
        flying = (flying | late[step]) & ~contact
    return landed


def landing_offsets(landed: Contacts, phase: Floats) -> Floats:
    """Return the phase of each leg relative to the first leg, by mean landing, cycles in [-1/2, 1/2], (..., 4).

    Takes landings (steps, ..., 4) and the clock phase (steps, ...), rad. The result is nan for a foot that never
    landed.
    """
    mean = (landed * np.exp(1j * phase)[..., None]).sum(axis=0)
    angle = np.where(mean == 0.0, np.nan, np.angle(mean))
    return wrapped((angle[..., :1] - angle) / TURN)


def wrapped(cycles: Floats) -> Floats:
    """Return the share of a cycle, wrapped to [-1/2, 1/2)."""
    return (cycles + 0.5) % 1.0 - 0.5
