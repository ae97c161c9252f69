"""Isaac Lab's IO descriptor, which `export_IO_descriptors` writes into `io_descriptors` of a run.

Sources: `isaaclab/envs/manager_based_env.py` (`export_IO_descriptors`), `docs/source/policy_deployment`: terms of
actions and observations in their order, with the joints of each by name; `default_joint_stiffness` and
`default_joint_damping` are 0 for joints with explicit actuators, whose gains are in `params/env.yaml` alone.
"""

from dataclasses import replace
from pathlib import Path
from typing import Any

from policies.base import PolicyError
from policies.external.readers.drafts import IncompleteSpecError
from policies.external.readers.isaac_terms import incomplete_remarks, make_term, observed_order
from policies.external.readers.joint_orders import JointNames
from policies.external.readers.settings import WRITE_TOML, FileSettings, load_settings, matches
from policies.external.spec import ObservationTerm, PolicySpec
from quad_env.files.text import brief

FOLDER = "io_descriptors"
"""Folder of the descriptors in a run."""
ENDS = ("*IO_descriptors.yaml", "*IO_descriptor.yaml")
"""Patterns of the descriptors' names."""


def is_descriptor(settings: FileSettings) -> bool:
    """Return whether the settings are an IO descriptor."""
    return isinstance(settings.find("actions"), list) and isinstance(settings.find("articulations"), dict)


def parse_spec(settings: FileSettings) -> PolicySpec:
    """Return the policy of an IO descriptor. Raises PolicyError; Incomplete without gains."""
    robot = _robot(settings)
    action = _action(settings)
    joints = action.texts("joint_names")
    assets = robot.texts("joint_names")
    if sorted(joints) != sorted(assets) or len(joints) != 12:
        raise action.invalid_value("joint_names", "the 12 joints of the articulation")
    order = [assets.index(name) for name in joints]
    default = tuple(robot.numbers("default_joint_pos")[place] for place in order)
    offset = action.numbers("offset", default=0.0)
    groups = dict(settings.section("observations").values)
    policy = groups.get("policy", next(iter(groups.values()), None))
    if not isinstance(policy, list):
        raise settings.invalid_value("observations", "lists of terms")
    given = [_settings_of(each, settings) for each in policy]
    terms = {str(place): _term(each) for place, each in enumerate(given)}
    observed = observed_order(terms, lambda key: given[int(key)].texts("joint_names"))
    scene = settings.section("scene")
    known: dict[str, Any] = {
        "control_rate": 1 / scene.number("dt"),
        "joints": joints,
        "default_position": default,
        "action_scale": action.numbers("scale", default=1.0),
        "action_offset": offset if offset != default else None,
        "terms": tuple(terms.values()),
        "observed_joints": observed if observed != joints else None,
    }
    stiffness, damping = _gains(settings, robot, joints, order)
    if min(stiffness) <= 0.0:
        known = {name: value for name, value in known.items() if value is not None}
        advice = ("the gains are those of its explicit actuators: params/env.yaml of the run has them",)
        raise IncompleteSpecError("an IO descriptor of Isaac Lab with explicit actuators", known, advice)
    remarks = incomplete_remarks((each.text("name"), each) for each in given)
    return PolicySpec(network=settings.network(), stiffness=stiffness, damping=damping, remarks=remarks, **known)


def joint_order(env: Path) -> JointNames | None:
    """Return the order of the robot's joints by the IO descriptor of the run of an `env.yaml`; None without one."""
    run = env.parent.parent if env.parent.name == "params" else env.parent
    folders = dict.fromkeys((run / FOLDER, run, env.parent))
    files = [file for folder in folders for end in ENDS for file in sorted(folder.glob(end))]
    if len(files) != 1 or not is_descriptor(found := load_settings(files[0])):
        return None
    return _robot(found).texts("joint_names")


def _robot(settings: FileSettings) -> FileSettings:
    """Return the only articulation, or the one called robot."""
    articulations = settings.section("articulations")
    groups = dict(articulations.sections())
    if "robot" in groups:
        return groups["robot"]
    if len(groups) != 1:
        raise settings.invalid_value("articulations", "one robot")
    return next(iter(groups.values()))


def _action(settings: FileSettings) -> FileSettings:
    """Return the only action, joint positions."""
    actions = [_settings_of(each, settings) for each in settings.get("actions")]
    kinds = [_function(action) for action in actions]
    if kinds not in (["JointPositionAction"], ["joint_position_action"]):
        raise PolicyError(f"the actions are {', '.join(kinds) or 'none'}: one JointPositionAction is read", WRITE_TOML)
    if actions[0].find("clip") is not None:
        raise actions[0].invalid_value("clip", "null; limits of targets are read from params/env.yaml")
    return actions[0]


def _settings_of(value: object, settings: FileSettings) -> FileSettings:
    """Return the settings of an entry of a list."""
    if not isinstance(value, dict):
        raise PolicyError(f"an action or observation in {settings.file.name} must be settings by key", WRITE_TOML)
    name = value.get("name", "")
    return FileSettings(value, settings.file, f"{name if isinstance(name, str) else brief(name)}.")


def _function(given: FileSettings) -> str:
    """Return the last part of the `full_path` of an action or observation, or its `name`. Raises PolicyError."""
    key = "full_path" if given.find("full_path") is not None else "name"
    return given.text(key).rpartition(".")[2]


def _term(given: FileSettings) -> ObservationTerm:
    """Return a term by the last part of its `full_path`, with its `overloads`."""
    function = _function(given)
    overloads = given.optional_section("overloads")
    extras = given.optional_section("extras")
    merged = {"params": given.find("params") or {}, "modifiers": extras.find("modifiers")} | overloads.values
    found = make_term(function, FileSettings(merged, given.file, given.key_prefix))
    shape = given.find("shape")
    if isinstance(shape, list) and len(shape) == 1 and isinstance(shape[0], int) and shape[0] % found.width:
        raise given.invalid_value("shape", f"[{found.width}]")
    return replace(found, history=max(1, found.history))


def _gains(
    settings: FileSettings, robot: FileSettings, joints: JointNames, order: list[int]
) -> tuple[tuple[float, ...], tuple[float, ...]]:
    """Return stiffness and damping of the joints, from `params/env.yaml` where the descriptor has zeros."""
    found = [robot.numbers(f"default_joint_{kind}") for kind in ("stiffness", "damping")]
    stiffness, damping = (tuple(values[place] for place in order) for values in found)
    run = settings.file.parent.parent if settings.file.parent.name in (FOLDER, "params") else settings.file.parent
    env = run / "params" / "env.yaml"
    if min(stiffness) > 0.0 or not env.is_file():
        return stiffness, damping
    actuators = load_settings(env).section("scene", "robot", "actuators")
    return _by_actuator(actuators, joints, "stiffness"), _by_actuator(actuators, joints, "damping")


def _by_actuator(actuators: FileSettings, joints: JointNames, kind: str) -> tuple[float, ...]:
    gains = []
    for joint in joints:
        its = [
            each for _, each in actuators.sections() if any(matches(p, joint) for p in each.texts("joint_names_expr"))
        ]
        if not its:
            raise PolicyError(f"no actuator in {actuators.file.name} has the joint {joint}")
        gains.append(its[0].joint_values(kind, (joint,))[0])
    return tuple(gains)
