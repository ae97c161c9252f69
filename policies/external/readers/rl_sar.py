"""rl_sar's `config.yaml`, with the `base.yaml` of its robot in the folder above; older ones have no base.

Sources: fan-ziqi/rl_sar `library/core/rl_sdk/rl_sdk.cpp` and `observation_buffer.cpp`: joint i of the policy is motor
`joint_mapping[i]`, observations are scaled, then clipped as a whole; a history starts with zeros, 0 is its newest step.
From v2.3 on, a history is in the order of `observations_history`. Up to v2.2, `get_obs_vec` walks through that list
from its end; `hip_scale_reduction` multiplies the actions of `hip_scale_reduction_indices`, also those that are
observed; vectors of joints are by leg, and with `framework: isaacsim` those of the policy are their `rows` x `cols`,
transposed (`ReadVectorFromYaml`). Files of v2.1 and older do not name the observation.
"""

from dataclasses import replace
from typing import Any, Literal

from policies.base import PolicyError
from policies.external.readers.isaac_terms import unknown_term, with_scale
from policies.external.readers.joint_orders import JointNames
from policies.external.readers.settings import WRITE_TOML, FileSettings, find_network, load_settings
from policies.external.spec import JOINT_FIELDS, ObservationTerm, PolicySpec, Range

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
"""Names and scales of the terms. `ang_vel_world` is read in the world frame and turned into the base frame;
`ang_vel_body` is read in the base frame.
"""
_OLD = "hip_scale_reduction", "hip_scale_reduction_indices", "rows", "cols"
"""Keys of files up to v2.2."""
_NEW = "command_mapping", "state_mapping", "joint_mapping", "observations_history_priority"
"""Keys of files from v2.3 on."""


def parse_spec(settings: FileSettings) -> PolicySpec:
    """The policy of a `config.yaml`, whose settings lie under the name of its folder. Raises PolicyError."""
    ((_, own),) = settings.sections()
    file = settings.file.parent.parent / "base.yaml"
    base = next((each for _, each in load_settings(file).sections()), None) if file.is_file() else None
    found = FileSettings((base.values if base else {}) | own.values, settings.file, own.key_prefix)
    for key in ("dt", "decimation", "num_of_dofs"):
        if base and base.find(key) not in (None, found.find(key)):
            raise _disagreement(settings, key)
    is_old = _is_before_v2_3(found)
    steps, newest = _history(found, is_old)
    scale = found.numbers("action_scale")
    described = PolicySpec(
        network=find_network(settings.file.parent, found.text("model_name")),
        control_rate=1 / (found.number("dt") * found.number("decimation")),
        joints=_joints(own, base, found),
        default_position=found.numbers("default_dof_pos"),
        action_scale=scale,
        action_clip=_action_clip(found),
        stiffness=found.numbers("rl_kp"),
        damping=found.numbers("rl_kd"),
        terms=_terms(found, steps),
        observation_clip=found.number("clip_obs"),
        history_layout="term" if found.find("observations_history_priority") == "term" else "time",
        history_newest=newest,
        history_start="zero",
    )
    return _with_settings_before_v2_3(described, found) if is_old else described


def _is_before_v2_3(found: FileSettings) -> bool:
    """Return whether a file is of v2.2 or older. Raises PolicyError where it has contradicting keys of both."""
    newer = [key for key in _NEW if found.find(key) is not None]
    newer += ["action_scale"] * isinstance(found.find("action_scale"), list)
    if not newer:
        return any(found.find(key) is not None for key in _OLD)
    if found.number("hip_scale_reduction", 1.0) != 1.0:
        raise found.invalid_value(
            "hip_scale_reduction", f"in `action_scale`, joint by joint, in a file with `{newer[0]}`"
        )
    return False


def _with_settings_before_v2_3(described: PolicySpec, found: FileSettings) -> PolicySpec:
    """Return the description with the settings of v2.2 and older: the framework's order and the reduction of hips."""
    framework = found.find("framework")
    if framework not in (None, "isaacgym", "isaacsim"):
        raise found.invalid_value("framework", "isaacgym or isaacsim")
    if framework == "isaacsim":
        rows = int(found.number("rows", 4.0))
        columns = int(found.number("cols", 3.0))
        if rows * columns != 12:
            raise found.invalid_value("rows", "a number with rows x cols = 12")
        order = [row * columns + column for column in range(columns) for row in range(rows)]
        moved: dict[str, Any] = {
            name: tuple(values[place] for place in order)
            for name in ("joints", *JOINT_FIELDS)
            if (values := getattr(described, name)) is not None
        }
        described = replace(described, **moved)
    reduction = found.number("hip_scale_reduction", 1.0)
    if reduction == 1.0:
        return described
    places = [int(each) for each in found.numbers("hip_scale_reduction_indices", None)]
    if not set(places) <= set(range(12)):
        raise found.invalid_value("hip_scale_reduction_indices", "places of joints, from 0 to 11")
    if any(term.name == "previous_action" for term in described.terms):
        shown = tuple(reduction if place in places else 1.0 for place in range(12))
        terms = [replace(term, scale=shown) if term.name == "previous_action" else term for term in described.terms]
        described = replace(described, terms=tuple(terms))
    scale = tuple(each * (reduction if place in places else 1.0) for place, each in enumerate(described.action_scale))
    return replace(described, action_scale=scale)


def _disagreement(settings: FileSettings, key: str) -> PolicyError:
    return PolicyError(f"`{key}` in {settings.file.name} and in ../base.yaml disagree", "make them one")


def _joints(own: FileSettings, base: FileSettings | None, found: FileSettings) -> JointNames:
    """Names in the policy's order: those in the file itself, or the base's by `joint_mapping`."""
    names, motors = _names(own), _names(base) if base else None
    if motors and (names is None or own.find("joint_mapping") is not None):
        mapped = tuple(motors[each] for each in found.permutation("joint_mapping")) if len(motors) == 12 else motors
        if names not in (None, mapped):
            raise _disagreement(own, "joint_names")
        return mapped
    if names is None:
        raise PolicyError(f"neither {own.file.name} nor ../base.yaml has `joint_names`", f"add it, or {WRITE_TOML}")
    return names


def _names(settings: FileSettings) -> JointNames | None:
    if settings.find("joint_names") is not None:
        return settings.texts("joint_names")
    if settings.find("joint_controller_names") is None:
        return None
    return tuple(name.replace("_controller", "_joint") for name in settings.texts("joint_controller_names"))


def _terms(found: FileSettings, steps: int) -> tuple[ObservationTerm, ...]:
    terms = []
    for name in found.texts("observations"):
        if name not in _TERMS:
            raise unknown_term(name)
        term, key = _TERMS[name]
        if key:
            found.get(key)
        terms.append(with_scale(ObservationTerm(term, history=steps), found, key))
    return tuple(terms)


def _history(found: FileSettings, is_old: bool) -> tuple[int, Literal["first", "last"]]:
    """Return the number of steps shown, and the place of the newest."""
    given: Any = found.find("observations_history") or [0]
    steps = list(range(len(given))) if isinstance(given, list) else []
    if not steps or given not in (steps, steps[::-1]):
        raise found.invalid_value("observations_history", "the steps from 0, or down to 0")
    return len(steps), "first" if (given == steps) is not is_old else "last"


def _action_clip(found: FileSettings) -> Range | None:
    if not found.find("clip_actions_upper") or not found.find("clip_actions_lower"):
        return None
    limits = {*zip(found.numbers("clip_actions_lower"), found.numbers("clip_actions_upper"), strict=True)}
    if len(limits) > 1:
        raise found.invalid_value("clip_actions_upper", "alike for all joints, as `clip_actions_lower`")
    return limits.pop()
