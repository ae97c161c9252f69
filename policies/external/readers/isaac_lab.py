"""Isaac Lab's `params/env.yaml`: an environment of managers, as `dump_yaml` writes it next to a run's networks.

Sources: `isaaclab/envs/mdp/actions/joint_actions.py` (target = raw action * scale + offset, then clipped),
`isaaclab/managers/manager_term_cfg.py`, `isaaclab/sensors/ray_caster/patterns/patterns.py` (order of a height scan),
`isaaclab/utils/string.py` (regular expressions over whole joint names).
"""

import re
from dataclasses import replace

from policies.base import PolicyError
from policies.external.readers.io_descriptor import joint_order
from policies.external.readers.isaac_terms import history_length, incomplete_remarks, make_term, observed_order
from policies.external.readers.joint_orders import FAMILIES, JointNames, names_by_kind
from policies.external.readers.settings import WRITE_TOML, FileSettings, load_settings, matches
from policies.external.spec import HeightGrid, ObservationTerm, PolicySpec, Range

_NAMES = "joint_names_expr"


def parse_spec(settings: FileSettings) -> PolicySpec:
    """The policy of an `env.yaml`. Raises PolicyError."""
    robot, action = settings.section("scene", "robot"), _action(settings)
    asset = joint_order(settings.file)
    if asset is None and settings.section("sim").find("newton_cfg") is None:
        asset = _asset(robot)
    joints = _chosen(action, asset)
    group = settings.section("observations", "policy")
    terms = {name: _term(settings, group, each) for name, each in group.sections()}
    observed = observed_order(
        terms, lambda name: _chosen(group.section(name).optional_section("params", "asset_cfg"), asset)
    )
    at_default, clip = action.find("use_default_offset") is True, action.optional_section("clip")
    return PolicySpec(
        network=settings.network(),
        control_rate=1 / (settings.number("decimation") * settings.section("sim").number("dt")),
        joints=joints,
        default_position=robot.section("init_state").joint_values("joint_pos", joints, 0.0),
        action_scale=action.joint_values("scale", joints, 1.0),
        action_offset=None if at_default else action.joint_values("offset", joints, 0.0),
        action_clip=_action_clip(settings),
        target_clip=tuple(clip.range(clip.matching_pattern(joint)) for joint in joints) if clip.values else None,
        stiffness=tuple(_gain(robot, joint, "stiffness") for joint in joints),
        damping=tuple(_gain(robot, joint, "damping") for joint in joints),
        terms=tuple(terms.values()),
        observed_joints=observed if observed != joints else None,
        remarks=incomplete_remarks((_function(each), each) for _, each in group.sections()),
    )


def _action(settings: FileSettings) -> FileSettings:
    """The only action, joint positions."""
    actions = dict(settings.section("actions").sections())
    kinds = {action.text("class_type").rpartition(":")[2] for action in actions.values()}
    if len(actions) != 1 or kinds != {"JointPositionAction"}:
        given = ", ".join(f"{name} ({action.text('class_type')})" for name, action in actions.items())
        raise PolicyError(f"the actions are {given or 'none'}: one JointPositionAction is read", WRITE_TOML)
    return next(iter(actions.values()))


def _asset(robot: FileSettings) -> JointNames | None:
    """The joints of a known robot: its family's names match all expressions, and its model's path names it; or None."""
    spawn = robot.section("spawn").values
    path = " ".join(f"{key} {value}" for key, value in spawn.items() if isinstance(value, str)).lower()
    patterns = [str(key) for key in robot.section("init_state", "joint_pos").values]
    patterns += [each for _, actuator in robot.section("actuators").sections() for each in actuator.texts(_NAMES)]
    orders = {words: names_by_kind(*family) for words, family in FAMILIES.items()}
    fit = [words for words, names in orders.items() if all(any(matches(p, n) for n in names) for p in patterns)]
    named = [words for words in fit if re.search(rf"(?<![a-z0-9])({words.replace(' ', '|')})", path)]
    return orders[named[0]] if named else None


def _chosen(settings: FileSettings, asset: JointNames | None) -> JointNames:
    """The joints that `joint_names` choose, in the asset's order unless `preserve_order`."""
    if settings.find("joint_names") is None and settings.find("joint_ids") is not None:
        raise settings.invalid_value("joint_ids", "absent, with the joints in `joint_names`")
    patterns = settings.texts("joint_names") if settings.find("joint_names") is not None else (".*",)
    kept = settings.find("preserve_order") is True
    if kept and len(patterns) == 12 and all(each.isidentifier() for each in patterns):
        return patterns
    if asset is None:
        known = ", ".join(word for words in FAMILIES for word in words.split())
        fault = f"the order of the joints is not known: it is that of {known} in PhysX alone"
        raise PolicyError(fault, f"add the run's IO descriptor (io_descriptors/*.yaml), or {WRITE_TOML}")
    if kept:
        return tuple(dict.fromkeys(name for each in patterns for name in asset if matches(each, name)))
    return tuple(name for name in asset if any(matches(each, name) for each in patterns))


def _term(settings: FileSettings, group: FileSettings, each: FileSettings) -> ObservationTerm:
    function = _function(each)
    if function == "generated_commands":
        name = each.section("params").text("command_name")
        kind = settings.section("commands", name).text("class_type").rpartition(":")[2]
        if "VelocityCommand" not in kind:
            raise PolicyError(f"the command {name} is a {kind}: commands of velocity are read", WRITE_TOML)
    found = make_term(function, each, _grid(settings, each.section("params")) if function == "height_scan" else None)
    return found if group.find("history_length") is None else replace(found, history=history_length(group))


def _function(term: FileSettings) -> str:
    return term.text("func").rpartition(":")[2]


def _grid(settings: FileSettings, params: FileSettings) -> HeightGrid:
    """Points of a height scan: a grid about the sensor, yawed with the trunk."""
    sensor = settings.section("scene", params.section("sensor_cfg").text("name"))
    if sensor.find("ray_alignment") != "yaw" and sensor.find("attach_yaw_only") is not True:
        raise sensor.invalid_value("ray_alignment", "yaw")
    grid = sensor.section("pattern_cfg")
    step, size, shift = (
        grid.number("resolution"),
        grid.numbers("size", 2),
        sensor.optional_section("offset").numbers("pos", 3, 0.0),
    )
    if not 0 < step <= min(size) or max(size) > 100 * step:
        raise grid.invalid_value("resolution", "a step that gives 2 to 100 points along each side")
    x, y = (
        tuple(round(middle - side / 2 + step * each, 9) for each in range(int((side + 1e-9) / step) + 1))
        for side, middle in zip(size, shift, strict=False)
    )
    return HeightGrid(x, y, x_first=grid.find("ordering") != "yx", offset=params.number("offset", 0.5))


def _gain(robot: FileSettings, joint: str, kind: str) -> float:
    """Stiffness or damping of a joint's actuator."""
    for _, actuator in robot.section("actuators").sections():
        if any(matches(each, joint) for each in actuator.texts(_NAMES)):
            return actuator.joint_values(kind, (joint,))[0]
    raise PolicyError(f"no actuator in {robot.file.name} has the joint {joint}")


def _action_clip(settings: FileSettings) -> Range | None:
    """What rsl_rl's wrapper clips raw actions to, by the `agent.yaml` next to the file."""
    agent = settings.file.with_name("agent.yaml")
    if not agent.is_file() or (found := load_settings(agent)).find("clip_actions") is None:
        return None
    return -found.number("clip_actions"), found.number("clip_actions")
