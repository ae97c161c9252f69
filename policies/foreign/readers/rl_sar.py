"""rl_sar's `config.yaml`, with the `base.yaml` of its robot in the folder above; older ones have no base.

Sources: fan-ziqi/rl_sar `library/core/rl_sdk/rl_sdk.cpp` and `observation_buffer.cpp`: joint i of the policy is motor
`joint_mapping[i]`, observations are scaled, then clipped as a whole; a history starts with zeros, 0 is its newest step.
"""

from typing import Any, Literal

from policies.base import PolicyError
from policies.foreign.description import TERMS, PolicyDescription, Range, Term
from policies.foreign.readers.isaac_terms import scaled
from policies.foreign.readers.joint_orders import Joints
from policies.foreign.readers.networks import named
from policies.foreign.readers.settings import BY_HAND, Settings, load

_TERMS = {
    "lin_vel": ("linear_velocity", "lin_vel_scale"),
    "ang_vel": ("angular_velocity", "ang_vel_scale"),
    "gravity_vec": ("projected_gravity", None),
    "commands": ("command", "commands_scale"),
    "dof_pos": ("joint_position", "dof_pos_scale"),
    "dof_vel": ("joint_velocity", "dof_vel_scale"),
    "actions": ("previous_action", None),
}


def describe(settings: Settings) -> PolicyDescription:
    """The policy of a `config.yaml`, whose settings lie under the name of its folder. Raises PolicyError."""
    found = _with_base(settings)
    if (count := found.number("num_of_dofs", 12)) != 12:
        raise PolicyError(f"`num_of_dofs` in {settings.file.name} is {count:g}: policies of 12 joints are read")
    if found.find("hip_scale_reduction") is not None:
        raise found.wrong("hip_scale_reduction", "in `action_scale`, joint by joint")
    steps, newest = _history(found)
    return PolicyDescription(
        network=named(settings.file.parent, str(found.get("model_name"))),
        control_rate=1 / (found.number("dt") * found.number("decimation")),
        joints=_joints(settings, found),
        default_position=found.numbers("default_dof_pos"),
        action_scale=found.numbers("action_scale"),
        action_clip=_action_clip(found),
        stiffness=found.numbers("rl_kp"),
        damping=found.numbers("rl_kd"),
        terms=_terms(found, steps),
        observation_clip=found.number("clip_obs"),
        history_layout="term" if found.find("observations_history_priority") == "term" else "time",
        history_newest=newest,
        history_start="zero",
    )


def _with_base(settings: Settings) -> Settings:
    """The settings, and those of the base that they do not give."""
    ((_, own),) = settings.groups()
    base = _base(settings)
    for key in ("dt", "decimation", "num_of_dofs"):
        if None not in (own.find(key), base.find(key)) and own.find(key) != base.find(key):
            raise _disagree(settings, key)
    return Settings(base.values | own.values, settings.file, own.above)


def _base(settings: Settings) -> Settings:
    file = settings.file.parent.parent / "base.yaml"
    return next((each for _, each in load(file).groups()), Settings({}, file)) if file.is_file() else Settings({}, file)


def _disagree(settings: Settings, key: str) -> PolicyError:
    return PolicyError(f"`{key}` in {settings.file.name} and in ../base.yaml disagree", "make them one")


def _joints(settings: Settings, found: Settings) -> Joints:
    """Names in the policy's order: those in the file itself, or the base's by `joint_mapping`."""
    ((_, own),) = settings.groups()
    listed = [_names(each) for each in (own, _base(settings))]
    if listed[1] and (listed[0] is None or own.find("joint_mapping") is not None):
        if len(listed[1]) != 12:
            raise PolicyError(f"base.yaml names {len(listed[1])} joints: policies of 12 are read")
        listed[1] = tuple(listed[1][each] for each in found.order("joint_mapping"))
        if listed[0] not in (None, listed[1]):
            raise _disagree(settings, "joint_names")
    if (names := listed[0] or listed[1]) is None:
        raise PolicyError(f"neither {settings.file.name} nor ../base.yaml has `joint_names`", f"add it, or {BY_HAND}")
    return names


def _names(settings: Settings) -> Joints | None:
    for key, end in (("joint_names", ""), ("joint_controller_names", "_controller")):
        if settings.find(key) is not None:
            return tuple(f"{name.removesuffix(end)}_joint" if end else name for name in settings.texts(key))
    return None


def _terms(found: Settings, steps: int) -> tuple[Term, ...]:
    terms = []
    for name in found.texts("observations"):
        if name not in _TERMS:
            raise PolicyError(
                f"the observation term {name} is not known", f"{BY_HAND} with terms of {', '.join(TERMS)}"
            )
        term, key = _TERMS[name]
        if key is not None:
            found.get(key)
        terms.append(scaled(Term(term, history=steps), found, key or ""))
    if (width := sum(term.width for term in terms)) != found.number("num_observations", width):
        raise found.wrong("num_observations", f"{width}, the numbers of `observations`")
    return tuple(terms)


def _history(found: Settings) -> tuple[int, Literal["first", "last"]]:
    """How many steps, and where the newest is."""
    given: Any = found.find("observations_history") or [0]
    steps = list(range(len(given))) if isinstance(given, list) else []
    if not steps or given not in (steps, steps[::-1]):
        raise found.wrong("observations_history", "the steps from 0, or down to 0")
    return len(steps), "first" if given == steps else "last"


def _action_clip(found: Settings) -> Range | None:
    if not found.find("clip_actions_upper") or not found.find("clip_actions_lower"):
        return None
    limits = {*zip(found.numbers("clip_actions_lower"), found.numbers("clip_actions_upper"), strict=True)}
    if len(limits) > 1:
        raise found.wrong("clip_actions_upper", "alike for all joints, as `clip_actions_lower`")
    return limits.pop()
