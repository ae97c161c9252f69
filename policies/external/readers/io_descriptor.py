"""Reader of the IO descriptor of Isaac Lab, a YAML file that describes a policy's inputs and outputs.

`export_IO_descriptors` writes this file into the folder `io_descriptors` of a training run. An IO descriptor lists the
terms of the actions and observations in their order, with the joint names of each term.

The keys `default_joint_stiffness` and `default_joint_damping` are 0 for joints with explicit actuators, which Isaac Lab
computes outside of the physics engine. The gains of explicit actuators are only in `params/env.yaml`.

Sources: `isaaclab/envs/manager_based_env.py` (`export_IO_descriptors`), `docs/source/policy_deployment`.
"""

from dataclasses import replace
from pathlib import Path
from typing import Any

from policies.base import PolicyError
from policies.external.readers.drafts import IncompleteSpecError
from policies.external.readers.isaac_terms import incomplete_remarks, make_term, observed_order
from policies.external.readers.joint_orders import JointNames
from policies.external.readers.settings import WRITE_TOML, FileSettings, joint_name_matches, load_settings
from policies.external.spec import Numbers, PolicySpec, SpecTerm
from quad_env.files.text import brief

FOLDER = "io_descriptors"
"""Name of the folder in an Isaac Lab training run that contains IO descriptors."""
FILE_PATTERNS = ("*IO_descriptors.yaml", "*IO_descriptor.yaml")
"""Patterns (glob) of the file names of Isaac Lab's IO descriptors."""


def is_descriptor(settings: FileSettings) -> bool:
    """Return True if the settings of a file have the form of Isaac Lab's IO descriptor."""
    return isinstance(settings.find("actions"), list) and isinstance(settings.find("articulations"), dict)


def parse_spec(settings: FileSettings) -> PolicySpec:
    """Parse a policy's specification from Isaac Lab's IO descriptor.

    Args:
        settings: Settings of the IO descriptor.

    Returns:
        Specification of the policy.

    Raises:
        IncompleteSpecError: The joints have explicit actuators, and `params/env.yaml` with their gains is missing.
    """
    robot = _find_robot(settings)
    action = _find_action(settings)
    joints = action.texts("joint_names")
    order = _joint_order(action, robot)
    observations = [_entry_settings(each, settings) for each in _observation_list(settings)]
    known = {
        "control_rate": 1 / settings.section("scene").number("dt"),
        "joints": joints,
        **_parse_positions(action, robot, order),
        **_parse_observation(observations, joints),
    }
    stiffness, damping = _parse_gains(settings, robot, joints, order)
    if min(stiffness) <= 0.0:
        known = {name: value for name, value in known.items() if value is not None}
        advice = ("the gains are those of its explicit actuators: params/env.yaml of the run has them",)
        raise IncompleteSpecError("an IO descriptor of Isaac Lab with explicit actuators", known, advice)
    remarks = incomplete_remarks((term.text("name"), term) for term in observations)
    return PolicySpec(network=settings.network(), stiffness=stiffness, damping=damping, remarks=remarks, **known)


def _joint_order(action: FileSettings, robot: FileSettings) -> list[int]:
    """Return, for each joint of the action term, its index among the joints of the articulation (robot).

    Raises PolicyError if the joints of the action term are not the 12 joints of the articulation.
    """
    joints = action.texts("joint_names")
    asset_joints = robot.texts("joint_names")
    if sorted(joints) != sorted(asset_joints) or len(joints) != 12:
        action.raise_invalid("joint_names", "the 12 joints of the articulation")
    return [asset_joints.index(name) for name in joints]


def _parse_positions(action: FileSettings, robot: FileSettings, order: list[int]) -> dict[str, Any]:
    """Return the fields `default_position`, `action_scale` and `action_offset` of a specification.

    The result is a dictionary: field name -> value. `order` has, for each joint of the action, its index among the
    joints of the robot.
    """
    default_position = tuple(robot.numbers("default_joint_pos")[index] for index in order)
    offset = action.numbers("offset", default=0.0)
    return {
        "default_position": default_position,
        "action_scale": action.numbers("scale", default=1.0),
        "action_offset": offset if offset != default_position else None,
    }


def _observation_list(settings: FileSettings) -> list[Any]:
    """Return the descriptions of the observation terms in an IO descriptor, in their order.

    They are in the observation group `policy`, or in the first group if there is no group with this name. Raises
    PolicyError if the group is not a list.
    """
    groups = dict(settings.section("observations").values)
    policy = groups.get("policy", next(iter(groups.values()), None))
    if not isinstance(policy, list):
        settings.raise_invalid("observations", "lists of terms")
    return policy


def _parse_observation(observations: list[FileSettings], joints: JointNames) -> dict[str, Any]:
    """Return the specification's fields `terms` and `observed_joints`: name -> value.

    `observations` has the settings of each observation term. `joints` has the joint names in the order of the actions.
    """
    terms = {str(index): _parse_term(each) for index, each in enumerate(observations)}
    observed = observed_order(terms, lambda key: observations[int(key)].texts("joint_names"))
    return {"terms": tuple(terms.values()), "observed_joints": observed if observed != joints else None}


def joint_order(env: Path) -> JointNames | None:
    """Return the robot's joint names in Isaac Lab's order, from the IO descriptor of a training run.

    `env` is the path of the `env.yaml` of the training run. Returns None if the training run has no IO descriptor, or
    several.
    """
    run = env.parent.parent if env.parent.name == "params" else env.parent
    folders = dict.fromkeys((run / FOLDER, run, env.parent))
    files = [file for folder in folders for pattern in FILE_PATTERNS for file in sorted(folder.glob(pattern))]
    if len(files) != 1:
        return None
    descriptor = load_settings(files[0])
    return _find_robot(descriptor).texts("joint_names") if is_descriptor(descriptor) else None


def _find_robot(settings: FileSettings) -> FileSettings:
    """Return the settings of the robot in an IO descriptor.

    The robot is the articulation with the name `robot`, or else the only articulation. Raises PolicyError if there are
    several articulations and none has this name, or if there are none.
    """
    articulations = settings.section("articulations")
    groups = dict(articulations.sections())
    if "robot" in groups:
        return groups["robot"]
    if len(groups) != 1:
        settings.raise_invalid("articulations", "one robot")
    return next(iter(groups.values()))


def _find_action(settings: FileSettings) -> FileSettings:
    """Return the settings of the only action term in an IO descriptor.

    Raises PolicyError if there are several action terms, or if the only term is not a JointPositionAction or has a
    clip.
    """
    actions = [_entry_settings(each, settings) for each in settings.get("actions")]
    kinds = [_function_name(action) for action in actions]
    if kinds not in (["JointPositionAction"], ["joint_position_action"]):
        raise PolicyError(
            f"the actions are {', '.join(kinds) or 'none'}; supported: one JointPositionAction", WRITE_TOML
        )
    if actions[0].find("clip") is not None:
        actions[0].raise_invalid("clip", "null; limits of targets are read from params/env.yaml")
    return actions[0]


def _entry_settings(value: object, settings: FileSettings) -> FileSettings:
    """Return the description `value` of an action or observation term as `FileSettings`.

    `settings` are the settings of the whole IO descriptor. Raises PolicyError if `value` is not a dictionary.
    """
    if not isinstance(value, dict):
        raise PolicyError(f"an action or observation in {settings.file.name} must be settings by key", WRITE_TOML)
    name = value.get("name", "")
    return FileSettings(value, settings.file, f"{name if isinstance(name, str) else brief(name)}.")


def _function_name(entry: FileSettings) -> str:
    """Return the name of the Isaac Lab function or class that computes an action or observation term.

    It is the last part of the term's `full_path`, or of its `name` if there is no path. Raises PolicyError if both keys
    are missing.
    """
    key = "full_path" if entry.find("full_path") is not None else "name"
    return entry.text(key).rpartition(".")[2]


def _parse_term(entry: FileSettings) -> SpecTerm:
    """Parse an observation term from its description in an IO descriptor.

    The settings in `overloads` replace the settings in `params` and `extras`. Raises PolicyError if the function of the
    term is unknown, or if the described shape differs from the width of this term.
    """
    function = _function_name(entry)
    overloads = entry.optional_section("overloads")
    extras = entry.optional_section("extras")
    merged = {"params": entry.find("params") or {}, "modifiers": extras.find("modifiers")} | overloads.values
    term = make_term(function, FileSettings(merged, entry.file, entry.key_prefix))
    shape = entry.find("shape")
    if isinstance(shape, list) and len(shape) == 1 and isinstance(shape[0], int) and shape[0] % term.width:
        entry.raise_invalid("shape", f"[{term.width}]")
    return replace(term, history=max(1, term.history))


def _parse_gains(
    settings: FileSettings, robot: FileSettings, joints: JointNames, order: list[int]
) -> tuple[Numbers, Numbers]:
    """Return stiffness, N·m/rad, and damping, N·m·s/rad, of the joints, in the order of the actions.

    The gains are read from `params/env.yaml` if a stiffness in the IO descriptor is 0 and this file exists. `order`
    has, for each joint of the action, its index among the joints of the robot.
    """
    gains = [robot.numbers(f"default_joint_{kind}") for kind in ("stiffness", "damping")]
    stiffness, damping = (tuple(values[index] for index in order) for values in gains)
    run = settings.file.parent.parent if settings.file.parent.name in (FOLDER, "params") else settings.file.parent
    env = run / "params" / "env.yaml"
    if min(stiffness) > 0.0 or not env.is_file():
        return stiffness, damping
    actuators = load_settings(env).section("scene", "robot", "actuators")
    return _parse_actuator_gains(actuators, joints, "stiffness"), _parse_actuator_gains(actuators, joints, "damping")


def _parse_actuator_gains(actuators: FileSettings, joints: JointNames, kind: str) -> Numbers:
    """Return the stiffness, N·m/rad, or the damping, N·m·s/rad, of each joint in `joints`.

    `kind` is `stiffness` or `damping`. The value of a joint is taken from the first actuator in `params/env.yaml` with
    a pattern that matches the joint's name. Raises PolicyError if no actuator matches.
    """
    gains = []
    for joint in joints:
        matching = [
            actuator
            for _, actuator in actuators.sections()
            if any(joint_name_matches(pattern, joint) for pattern in actuator.texts("joint_names_expr"))
        ]
        if not matching:
            raise PolicyError(f"no actuator in {actuators.file.name} has the joint {joint}")
        gains.append(matching[0].joint_values(kind, (joint,))[0])
    return tuple(gains)
