"""Observation terms by Isaac Lab's function names, which mjlab and Unitree share: clipped, then scaled.

Sources: `isaaclab/managers/observation_manager.py`, `isaaclab/envs/mdp/observations.py`; unitree_rl_lab's
`mdp/observations.py` (gait_phase, a clock that always runs); newer unitree_rl_mjlab, `phase` of its training and
`gait_phase` of its `deploy/robots/*/src/State_RLBase.cpp` (the same clock, but (0, 0) where the norm of the command is
below 0.1); robot_lab's `mdp/observations.py` (phase). Histories lie by term, oldest first, and begin with the first
observation (`CircularBuffer`).
"""

from collections.abc import Callable, Iterable
from dataclasses import replace

from policies.base import PolicyError
from policies.external.readers.joint_orders import JointNames
from policies.external.readers.settings import WRITE_TOML, FileSettings
from policies.external.spec import TERM_WIDTHS, HeightGrid, ObservationTerm
from quad_env.files.text import MAX_SHOWN, brief

FUNCTIONS = {
    "base_lin_vel": "linear_velocity",
    "base_ang_vel": "angular_velocity",
    "projected_gravity": "projected_gravity",
    "generated_commands": "command",
    "velocity_commands": "command",
    "keyboard_velocity_commands": "command",
    "joint_pos": "absolute_joint_position",
    "joint_pos_rel": "joint_position",
    "joint_vel": "joint_velocity",
    "joint_vel_rel": "joint_velocity",
    "joint_effort": "joint_torque",
    "last_action": "previous_action",
    "height_scan": "height_scan",
    "gait_phase": "gait_clock",
    "gait_phase_my": "gait_clock",
    "phase": "gait_clock",
}
_OF_JOINTS = {"absolute_joint_position", "joint_position", "joint_velocity", "joint_torque"}
_PERIODS = {"gait_phase": "period", "gait_phase_my": "period", "phase": "cycle_time"}
ZERO_BELOW = 0.1
"""Norm of a command below which newer unitree_rl_mjlab shows its clock as (0, 0)."""
_THRESHOLDS = "command_threshold", "zero_below"
"""Parameters with another threshold."""


def make_term(function: str, settings: FileSettings, grid: HeightGrid | None = None) -> ObservationTerm:
    """A term by the name of its function, with its `params`, `clip`, `scale`, `history_length`. Raises PolicyError."""
    name = FUNCTIONS.get(function)
    if name is None or (name == "height_scan" and grid is None):
        raise unknown_term(function)
    if settings.find("modifiers"):
        raise unknown_term(f"{function} with modifiers")
    clip = None if settings.find("clip") is None else settings.range("clip")
    clock, zero_below = _clock(function, settings)
    found = ObservationTerm(
        name, clip=clip, history=history_length(settings), clock=clock, grid=grid, zero_below=zero_below
    )
    return with_scale(found, settings)


def _clock(function: str, settings: FileSettings) -> tuple[float, float]:
    """Return a clock's cycles a second, Hz, and the norm of a command below which it is zero; 0 for other functions."""
    if function not in _PERIODS:
        return 0.0, 0.0
    params = settings.section("params")
    key = _PERIODS[function] if params.find(_PERIODS[function]) is not None else "period"
    given = [each for each in _THRESHOLDS if params.find(each) is not None]
    is_gated = function == "gait_phase_my" or params.find("command_name") is not None
    threshold = params.number(given[0]) if given else ZERO_BELOW * is_gated
    return 1 / params.number(key), threshold


def incomplete_remarks(terms: Iterable[tuple[str, FileSettings]]) -> tuple[str, ...]:
    """Return a line for each term, by function, that a file leaves incomplete."""
    return tuple(
        f"{function} in {settings.file.name} does not say whether it is (0, 0) at commands below {ZERO_BELOW:g}, as in "
        f"newer unitree_rl_mjlab; read as a clock that always runs, else set `zero_below = {ZERO_BELOW:g}` in a TOML"
        for function, settings in terms
        if function in ("gait_phase", "phase") and not _clock(function, settings)[1]
    )


def with_scale(term: ObservationTerm, settings: FileSettings, key: str = "scale") -> ObservationTerm:
    """A term with the scale that a key gives, if it does: one number where all are alike."""
    if settings.find(key) is None:
        return term
    found = replace(term, scale=settings.numbers(key, None))
    return replace(found, scale=found.scale[:1]) if len(set(found.scale)) == 1 else found


def history_length(settings: FileSettings) -> int:
    """The `history_length`, where 0 stands for the present step alone."""
    return max(1, int(settings.number("history_length", 1)))


def observed_order(terms: dict[str, ObservationTerm], order: Callable[[str], JointNames]) -> JointNames | None:
    """The one order in which terms, by key, observe the joints; None where they observe none. Raises PolicyError."""
    orders = {order(key) for key, each in terms.items() if each.name in _OF_JOINTS}
    if len(orders) > 1:
        raise PolicyError("the joints are observed in several orders (`params.asset_cfg`): one is read", WRITE_TOML)
    return next(iter(orders), None)


def unknown_term(term: str) -> PolicyError:
    """The error for a term that is not known."""
    shown = term if len(term) <= MAX_SHOWN else brief(term)
    return PolicyError(
        f"the observation term {shown} is not known", f"{WRITE_TOML} with terms of {', '.join(TERM_WIDTHS)}"
    )
