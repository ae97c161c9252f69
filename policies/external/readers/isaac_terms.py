"""Parsing of observation terms by Isaac Lab's function names, which mjlab and Unitree use as well.

In Isaac Lab, terms are clipped and then scaled. A history keeps the control steps of a term together, with the oldest
step first. At the start of an episode, the history is filled with the first observation (`CircularBuffer`).

Sources:
- `isaaclab/managers/observation_manager.py`, `isaaclab/envs/mdp/observations.py`.
- unitree_rl_lab `mdp/observations.py`: `gait_phase` is a clock that always runs.
- Newer unitree_rl_mjlab: `phase` in training and `gait_phase` in `deploy/robots/*/src/State_RLBase.cpp` are the same
  clock, but it is (0, 0) if the norm of the command is below 0.1.
- robot_lab `mdp/observations.py`: `phase`.
"""

from collections.abc import Callable, Iterable
from dataclasses import replace
from typing import NoReturn

from policies.base import PolicyError
from policies.external.readers.joint_orders import JointNames
from policies.external.readers.settings import WRITE_TOML, FileSettings
from policies.external.spec import TERM_WIDTHS, HeightGrid, SpecTerm
from quad_env.files.text import MAX_SHOWN, brief

TERM_NAMES = {
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
"""Name of Isaac Lab's function for an observation term -> name of the term in this project."""
_JOINT_TERMS = {"absolute_joint_position", "joint_position", "joint_velocity", "joint_torque"}
"""Names of the observation terms with the joint angles, velocities or torques."""
_PERIOD_KEYS = {"gait_phase": "period", "gait_phase_my": "period", "phase": "cycle_time"}
"""Name of the function of a gait clock -> key of the parameter with the clock's period, s."""
ZERO_BELOW = 0.1
"""Norm of the velocity command below which the gait clock of newer unitree_rl_mjlab is (0, 0)."""
_THRESHOLD_KEYS = "command_threshold", "zero_below"
"""Keys of a gait clock's parameter for the command norm below which the clock is (0, 0).

If the parameters of the clock have one of the keys, its value replaces ZERO_BELOW."""


def make_term(function: str, settings: FileSettings, grid: HeightGrid | None = None) -> SpecTerm:
    """Make an observation term from the name of its function in Isaac Lab and from its settings.

    Raises PolicyError if the function is unknown, or if the term has modifiers, which are not supported.

    Args:
        function: Name of Isaac Lab's function that computes the term, for example `joint_pos_rel`. The keys of
            TERM_NAMES are the known functions.
        settings: Settings of the term with the keys `params`, `clip`, `scale` and `history_length`.
        grid: Grid of the points of a height scan; None for other terms.

    Returns:
        Observation term of a specification.
    """
    name = TERM_NAMES.get(function)
    if name is None or (name == "height_scan" and grid is None):
        raise_unknown_term(function)
    if settings.find("modifiers"):
        raise_unknown_term(f"{function} with modifiers")
    clip = None if settings.find("clip") is None else settings.range("clip")
    clock, zero_below = _parse_clock(function, settings)
    history = history_length(settings)
    term = SpecTerm(name, clip=clip, history=history, clock=clock, grid=grid, zero_below=zero_below)
    return with_scale(term, settings)


def _parse_clock(function: str, settings: FileSettings) -> tuple[float, float]:
    """Return the frequency of a gait clock, Hz, and the command norm below which the clock is (0, 0).

    `function` is the name of Isaac Lab's function, and `settings` are the settings of the term. Both numbers are 0 for
    functions that are not gait clocks.
    """
    if function not in _PERIOD_KEYS:
        return 0.0, 0.0
    params = settings.section("params")
    key = _PERIOD_KEYS[function] if params.find(_PERIOD_KEYS[function]) is not None else "period"
    threshold_keys = [each for each in _THRESHOLD_KEYS if params.find(each) is not None]
    is_gated = function == "gait_phase_my" or params.find("command_name") is not None
    threshold = params.number(threshold_keys[0]) if threshold_keys else ZERO_BELOW * is_gated
    return 1 / params.number(key), threshold


def incomplete_remarks(terms: Iterable[tuple[str, FileSettings]]) -> tuple[str, ...]:
    """Return a remark, one line, for each gait clock if its settings contain no threshold.

    The threshold is the norm of the velocity command below which the clock is (0, 0). If it is missing, the clock is
    assumed to run always. `terms` has pairs: name of Isaac Lab's function for a term, and settings of the term.
    """
    return tuple(
        f"{function} in {settings.file.name} does not say whether it is (0, 0) at commands below {ZERO_BELOW:g}, as in "
        f"newer unitree_rl_mjlab; read as a clock that always runs, else set `zero_below = {ZERO_BELOW:g}` in a TOML"
        for function, settings in terms
        if function in ("gait_phase", "phase") and not _parse_clock(function, settings)[1]
    )


def with_scale(term: SpecTerm, settings: FileSettings, key: str = "scale") -> SpecTerm:
    """Return a copy of an observation term with the scale in its settings.

    The scale becomes a single number if all its numbers are equal.

    Args:
        term: Observation term.
        settings: Settings with the scale.
        key: Key of the scale; the term is returned unchanged if the settings lack this key.

    Returns:
        Observation term with the scale.
    """
    if settings.find(key) is None:
        return term
    scaled = replace(term, scale=settings.numbers(key, None))
    return replace(scaled, scale=scaled.scale[:1]) if len(set(scaled.scale)) == 1 else scaled


def history_length(settings: FileSettings) -> int:
    """Return the number of control steps of a term in the observation.

    This is the setting `history_length`. The number is 1 if the setting is 0 or missing, because the present step is
    always observed.
    """
    return max(1, int(settings.number("history_length", 1)))


def observed_order(terms: dict[str, SpecTerm], order: Callable[[str], JointNames]) -> JointNames | None:
    """Return the joint names in the order in which the observation terms list the joints.

    Args:
        terms: Key of each observation term in its file -> term.
        order: Function from the key of a term to the joint names in the order of this term.

    Returns:
        Joint names; None if no term contains joint angles, velocities or torques.

    Raises:
        PolicyError: Two terms have the joints in different orders.
    """
    orders = {order(key) for key, term in terms.items() if term.name in _JOINT_TERMS}
    if len(orders) > 1:
        raise PolicyError(
            "the joints are observed in several orders (`params.asset_cfg`); supported: one order", WRITE_TOML
        )
    return next(iter(orders), None)


def raise_unknown_term(name: str) -> NoReturn:
    """Raise the PolicyError for an unknown observation term `name`; the error lists the valid terms."""
    shown = name if len(name) <= MAX_SHOWN else brief(name)
    valid = ", ".join(TERM_WIDTHS)
    raise PolicyError(f"the observation term {shown} is not known", f"{WRITE_TOML} with terms of {valid}")
