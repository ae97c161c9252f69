"""Reader of rl_sar's deployment files: a policy's `config.yaml`, and the robot's `base.yaml`.

In newer versions, `base.yaml` is in the folder above `config.yaml`.

All versions:
- Joint i of the policy is motor `joint_mapping[i]`.
- Observation terms are scaled first; then the whole observation is clipped.
- The history of the observation starts with zeros. Step 0 in `observations_history` is the newest control step.

Version 2.3 and newer: the history has the order of `observations_history`.

Version 2.2 and older:
- The history has the reverse order of `observations_history`, because `get_obs_vec` reads the list from its end.
- `hip_scale_reduction` is a factor on the actions, and on the observed actions, of the joints with the indices
  `hip_scale_reduction_indices`.
- The values per joint are listed by leg. With `framework: isaacsim`, they are read as a matrix of `rows` x `cols`
  numbers. The numbers of the transposed matrix have the policy's joint order (`ReadVectorFromYaml`).

Version 2.1 and older: the file does not name the observation terms.

Sources: fan-ziqi/rl_sar `library/core/rl_sdk/rl_sdk.cpp` and `observation_buffer.cpp`.
"""

from dataclasses import replace
from typing import Any, Literal, NoReturn

from policies.base import PolicyError
from policies.external.readers.isaac_terms import raise_unknown_term, with_scale
from policies.external.readers.joint_orders import JointNames
from policies.external.readers.settings import WRITE_TOML, FileSettings, find_network, load_settings
from policies.external.spec import JOINT_FIELDS, PolicySpec, Range, SpecTerm

_TERMS = {
    "lin_vel": ("linear_velocity", "lin_vel_scale"),
    "ang_vel": ("angular_velocity", "ang_vel_scale"),
    "ang_vel_body": ("angular_velocity", "ang_vel_scale"),
    "ang_vel_world": ("angular_velocity", "ang_vel_scale"),
    "gravity_vec": ("projected_gravity", ""),
    "commands": ("command", "commands_scale"),
    "dof_pos": ("joint_position", "dof_pos_scale"),
    "dof_vel": ("joint_velocity", "dof_vel_scale"),
    "actions": ("previous_action", ""),
}
"""Name of an observation term in rl_sar -> name of the term in this project, and key of its scale.

An empty key means that the term has no scale.

rl_sar reads `ang_vel_world` in the world frame and rotates it to the base frame. It reads `ang_vel_body` in the base
frame. Both are therefore observed in the base frame.
"""
_KEYS_BEFORE_V2_3 = "hip_scale_reduction", "hip_scale_reduction_indices", "rows", "cols"
"""Keys that identify a `config.yaml` of rl_sar version 2.2 or older."""
_KEYS_SINCE_V2_3 = "command_mapping", "state_mapping", "joint_mapping", "observations_history_priority"
"""Keys that identify a `config.yaml` of rl_sar version 2.3 or newer."""


def parse_spec(settings: FileSettings) -> PolicySpec:
    """Parse a policy's specification from rl_sar's `config.yaml`.

    Settings that this file lacks are taken from the robot's `base.yaml`, if it exists. Raises PolicyError if a setting
    is missing, wrong or unsupported.

    Args:
        settings: Settings of the `config.yaml`, with one section; its key names the folder of the file.

    Returns:
        Specification of the policy.
    """
    ((_, own),) = settings.sections()
    base = _load_base(settings)
    merged = FileSettings((base.values if base else {}) | own.values, settings.file, own.key_prefix)
    for key in ("dt", "decimation", "num_of_dofs"):
        if base and base.find(key) not in (None, merged.find(key)):
            _raise_contradiction(settings, key)
    is_old = _is_before_v2_3(merged)
    steps, newest = _parse_history(merged, is_old)
    action_scale = merged.numbers("action_scale")
    spec = PolicySpec(
        network=find_network(settings.file.parent, merged.text("model_name")),
        control_rate=1 / (merged.number("dt") * merged.number("decimation")),
        joints=_parse_joints(own, base, merged),
        default_position=merged.numbers("default_dof_pos"),
        action_scale=action_scale,
        action_clip=_parse_action_clip(merged),
        stiffness=merged.numbers("rl_kp"),
        damping=merged.numbers("rl_kd"),
        terms=_parse_terms(merged, steps),
        observation_clip=merged.number("clip_obs"),
        history_layout="term" if merged.find("observations_history_priority") == "term" else "time",
        history_newest=newest,
        history_start="zero",
    )
    return _with_reduced_hips(_in_framework_order(spec, merged), merged) if is_old else spec


def _load_base(settings: FileSettings) -> FileSettings | None:
    """Return the first section of the robot's `base.yaml`, above the folder of `config.yaml`, or None.

    Returns None if this file does not exist. `settings` are the settings of `config.yaml`.
    """
    file = settings.file.parent.parent / "base.yaml"
    if not file.is_file():
        return None
    return next((section for _, section in load_settings(file).sections()), None)


def _is_before_v2_3(settings: FileSettings) -> bool:
    """Return True if the keys of a `config.yaml` belong to rl_sar version 2.2 or older.

    Raises PolicyError if the file has keys of a newer version and a `hip_scale_reduction` other than 1.
    """
    newer = [key for key in _KEYS_SINCE_V2_3 if settings.find(key) is not None]
    newer += ["action_scale"] * isinstance(settings.find("action_scale"), list)
    if not newer:
        return any(settings.find(key) is not None for key in _KEYS_BEFORE_V2_3)
    if settings.number("hip_scale_reduction", 1.0) != 1.0:
        expected = f"in `action_scale`, joint by joint, in a file with `{newer[0]}`"
        settings.raise_invalid("hip_scale_reduction", expected)
    return False


def _in_framework_order(spec: PolicySpec, settings: FileSettings) -> PolicySpec:
    """Return a specification from rl_sar v2.2 or older with its joints in the order of the policy.

    The files have the joints by leg. With `framework: isaacsim`, the order of the policy is by joint kind.
    """
    framework = settings.find("framework")
    if framework not in (None, "isaacgym", "isaacsim"):
        settings.raise_invalid("framework", "isaacgym or isaacsim")
    if framework != "isaacsim":
        return spec
    rows = int(settings.number("rows", 4.0))
    columns = int(settings.number("cols", 3.0))
    if rows * columns != 12:
        settings.raise_invalid("rows", "a number with rows x cols = 12")
    order = [row * columns + column for column in range(columns) for row in range(rows)]
    reordered: dict[str, Any] = {
        name: tuple(values[index] for index in order)
        for name in ("joints", *JOINT_FIELDS)
        if (values := getattr(spec, name)) is not None
    }
    return replace(spec, **reordered)


def _with_reduced_hips(spec: PolicySpec, settings: FileSettings) -> PolicySpec:
    """Return the specification with a smaller action scale of the hips, as rl_sar v2.2 and older have it.

    The action scale and the observed previous action of the hips are multiplied by `hip_scale_reduction`. The hips are
    the joints with the indices `hip_scale_reduction_indices`.
    """
    reduction = settings.number("hip_scale_reduction", 1.0)
    if reduction == 1.0:
        return spec
    hips = [int(index) for index in settings.numbers("hip_scale_reduction_indices", None)]
    if not set(hips) <= set(range(12)):
        settings.raise_invalid("hip_scale_reduction_indices", "places of joints, from 0 to 11")
    factors = tuple(reduction if index in hips else 1.0 for index in range(12))
    if any(term.name == "previous_action" for term in spec.terms):
        terms = [replace(term, scale=factors) if term.name == "previous_action" else term for term in spec.terms]
        spec = replace(spec, terms=tuple(terms))
    return replace(
        spec, action_scale=tuple(scale * factor for scale, factor in zip(spec.action_scale, factors, strict=True))
    )


def _raise_contradiction(settings: FileSettings, key: str) -> NoReturn:
    raise PolicyError(f"`{key}` in {settings.file.name} and in ../base.yaml disagree", "make them one")


def _parse_joints(own: FileSettings, base: FileSettings | None, merged: FileSettings) -> JointNames:
    """Return the joint names in the policy's joint order.

    They are the names in `config.yaml` (`own`), or the names in `base.yaml` (`base`) reordered by `joint_mapping`.
    `merged` has the settings of both files. Raises PolicyError if no file has names, or if the names contradict each
    other.
    """
    names = _joint_names(own)
    motors = _joint_names(base) if base else None
    if motors and (names is None or own.find("joint_mapping") is not None):
        mapped = tuple(motors[index] for index in merged.permutation("joint_mapping")) if len(motors) == 12 else motors
        if names not in (None, mapped):
            _raise_contradiction(own, "joint_names")
        return mapped
    if names is None:
        raise PolicyError(f"neither {own.file.name} nor ../base.yaml has `joint_names`", f"add it, or {WRITE_TOML}")
    return names


def _joint_names(settings: FileSettings) -> JointNames | None:
    if settings.find("joint_names") is not None:
        return settings.texts("joint_names")
    if settings.find("joint_controller_names") is None:
        return None
    return tuple(name.replace("_controller", "_joint") for name in settings.texts("joint_controller_names"))


def _parse_terms(settings: FileSettings, history: int) -> tuple[SpecTerm, ...]:
    """Return the observation terms in rl_sar's settings, each with a history of `history` control steps.

    Raises PolicyError if a term is unknown.
    """
    terms = []
    for name in settings.texts("observations"):
        if name not in _TERMS:
            raise_unknown_term(name)
        term_name, scale_key = _TERMS[name]
        if scale_key:
            settings.get(scale_key)
        terms.append(with_scale(SpecTerm(term_name, history=history), settings, scale_key))
    return tuple(terms)


def _parse_history(settings: FileSettings, is_old: bool) -> tuple[int, Literal["first", "last"]]:
    """Return the number of control steps in the observation, and the position of the newest step.

    The position is `first` or `last`. `is_old` is True for rl_sar version 2.2 and older, which has the reverse order.
    """
    given: Any = settings.find("observations_history") or [0]
    steps = list(range(len(given))) if isinstance(given, list) else []
    if not steps or given not in (steps, steps[::-1]):
        settings.raise_invalid("observations_history", "the steps from 0, or down to 0")
    return len(steps), "first" if (given == steps) is not is_old else "last"


def _parse_action_clip(settings: FileSettings) -> Range | None:
    """Return the minimum and maximum to which the raw outputs of the network are clipped; None: no limits.

    Raises PolicyError if the limits of the joints differ.
    """
    if not settings.find("clip_actions_upper") or not settings.find("clip_actions_lower"):
        return None
    lower = settings.numbers("clip_actions_lower")
    upper = settings.numbers("clip_actions_upper")
    limits = {*zip(lower, upper, strict=True)}
    if len(limits) > 1:
        settings.raise_invalid("clip_actions_upper", "equal for all joints, as `clip_actions_lower`")
    return limits.pop()
