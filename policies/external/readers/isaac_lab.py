"""Reader of Isaac Lab's `params/env.yaml`, the settings of the environment of a training run.

Isaac Lab's `dump_yaml` writes this file for a manager-based environment.

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
from policies.external.readers.settings import WRITE_TOML, FileSettings, joint_name_matches, load_settings
from policies.external.spec import HeightGrid, Numbers, PolicySpec, Range, SpecTerm

_ACTUATOR_JOINTS = "joint_names_expr"
"""Key of an actuator's settings with a list of regular expressions for the actuator's joint names."""


def parse_spec(settings: FileSettings) -> PolicySpec:
    """Parse a policy's specification from Isaac Lab's `env.yaml`.

    Raises PolicyError if a setting is missing, wrong or unsupported.
    """
    robot = settings.section("scene", "robot")
    action = _find_action(settings)
    asset_joints = joint_order(settings.file)
    if asset_joints is None and settings.section("sim").find("newton_cfg") is None:
        asset_joints = _known_robot_joints(robot)
    joints = _select_joints(action, asset_joints)
    group = settings.section("observations", "policy")
    terms = {name: _parse_term(settings, group, term) for name, term in group.sections()}
    clip = action.optional_section("clip")
    return PolicySpec(
        network=settings.network(),
        control_rate=1 / (settings.number("decimation") * settings.section("sim").number("dt")),
        joints=joints,
        default_position=robot.section("init_state").joint_values("joint_pos", joints, 0.0),
        action_scale=action.joint_values("scale", joints, 1.0),
        action_offset=_parse_offset(action, joints),
        action_clip=_parse_action_clip(settings),
        target_clip=tuple(clip.range(clip.matching_pattern(joint)) for joint in joints) if clip.values else None,
        stiffness=tuple(_parse_gain(robot, joint, "stiffness") for joint in joints),
        damping=tuple(_parse_gain(robot, joint, "damping") for joint in joints),
        terms=tuple(terms.values()),
        observed_joints=_parse_observed_joints(group, terms, joints, asset_joints),
        remarks=incomplete_remarks((_function_name(term), term) for _, term in group.sections()),
    )


def _find_action(settings: FileSettings) -> FileSettings:
    """Return the settings of the only action term in an `env.yaml`.

    Raises PolicyError if there are several action terms, or if the term is not a JointPositionAction.
    """
    actions = dict(settings.section("actions").sections())
    kinds = {action.text("class_type").rpartition(":")[2] for action in actions.values()}
    if len(actions) != 1 or kinds != {"JointPositionAction"}:
        given = ", ".join(f"{name} ({action.text('class_type')})" for name, action in actions.items())
        raise PolicyError(f"the actions are {given or 'none'}; supported: one JointPositionAction", WRITE_TOML)
    return next(iter(actions.values()))


def _known_robot_joints(robot: FileSettings) -> JointNames | None:
    """Return the joint names of a known robot in Isaac Lab's order, or None if the robot is unknown.

    FAMILIES lists the known robots; a family is a group of robots with equal joint names. The path of the robot's model
    must contain a word of a family, for example `go2`. Each regular expression for joint names in the settings must
    match a joint name of this family.
    """
    spawn = robot.section("spawn").values
    path = " ".join(f"{key} {value}" for key, value in spawn.items() if isinstance(value, str)).lower()
    patterns = [str(key) for key in robot.section("init_state", "joint_pos").values]
    for _, actuator in robot.section("actuators").sections():
        patterns += actuator.texts(_ACTUATOR_JOINTS)
    orders = {words: names_by_kind(*family) for words, family in FAMILIES.items()}
    fitting = [words for words, names in orders.items() if _has_matches(patterns, names)]
    named = [words for words in fitting if re.search(rf"(?<![a-z0-9])({words.replace(' ', '|')})", path)]
    return orders[named[0]] if named else None


def _has_matches(patterns: list[str], names: JointNames) -> bool:
    """Return True if each regular expression in `patterns` matches at least one of the joint names."""
    return all(any(joint_name_matches(pattern, name) for name in names) for pattern in patterns)


def _select_joints(settings: FileSettings, asset_joints: JointNames | None) -> JointNames:
    """Return the joint names of an action or observation term.

    The regular expressions under the key `joint_names` of the term's settings select the names. The result has the
    order of `asset_joints`, all joint names of the robot in Isaac Lab's order. If `preserve_order` is True, the result
    has the order of the expressions. Raises PolicyError if `asset_joints` is needed but None (unknown).
    """
    if settings.find("joint_names") is None and settings.find("joint_ids") is not None:
        settings.raise_invalid("joint_ids", "absent, with the joints in `joint_names`")
    patterns = settings.texts("joint_names") if settings.find("joint_names") is not None else (".*",)
    keeps_order = settings.find("preserve_order") is True
    if keeps_order and len(patterns) == 12 and all(pattern.isidentifier() for pattern in patterns):
        return patterns
    if asset_joints is None:
        known = ", ".join(word for words in FAMILIES for word in words.split())
        fault = f"unknown order of the joints; known: {known}, in PhysX"
        raise PolicyError(fault, f"add the run's IO descriptor (io_descriptors/*.yaml), or {WRITE_TOML}")
    if keeps_order:
        return tuple(
            dict.fromkeys(name for pattern in patterns for name in asset_joints if joint_name_matches(pattern, name))
        )
    return tuple(name for name in asset_joints if any(joint_name_matches(pattern, name) for pattern in patterns))


def _parse_offset(action: FileSettings, joints: JointNames) -> Numbers | None:
    """Return the joint targets at zero action, in the order of `joints`, rad.

    Returns None if the targets are the default position (setting `use_default_offset`).
    """
    if action.find("use_default_offset") is True:
        return None
    return action.joint_values("offset", joints, 0.0)


def _parse_observed_joints(
    group: FileSettings, terms: dict[str, SpecTerm], joints: JointNames, asset_joints: JointNames | None
) -> JointNames | None:
    """Return the joint names in the order of the observation; None if it is the action order `joints`."""

    def order(name: str) -> JointNames:
        return _select_joints(group.section(name).optional_section("params", "asset_cfg"), asset_joints)

    observed = observed_order(terms, order)
    return observed if observed != joints else None


def _parse_term(settings: FileSettings, group: FileSettings, term: FileSettings) -> SpecTerm:
    """Parse an observation term from its settings `term`.

    If the observation group `group` has a history length, it replaces the history length of the term. Raises
    PolicyError if the term is not supported.
    """
    function = _function_name(term)
    if function == "generated_commands":
        name = term.section("params").text("command_name")
        kind = settings.section("commands", name).text("class_type").rpartition(":")[2]
        if "VelocityCommand" not in kind:
            raise PolicyError(f"the command {name} is a {kind}; supported: velocity commands", WRITE_TOML)
    grid = _parse_grid(settings, term.section("params")) if function == "height_scan" else None
    parsed = make_term(function, term, grid)
    return parsed if group.find("history_length") is None else replace(parsed, history=history_length(group))


def _function_name(term: FileSettings) -> str:
    return term.text("func").rpartition(":")[2]


def _parse_grid(settings: FileSettings, params: FileSettings) -> HeightGrid:
    """Parse the grid of a height scan from the settings of its sensor.

    `settings` are the settings of the environment, and `params` the parameters of the observation term, which name the
    sensor. Raises PolicyError if the grid does not turn with the trunk's yaw, or has too few or too many points.
    """
    sensor = settings.section("scene", params.section("sensor_cfg").text("name"))
    if sensor.find("ray_alignment") != "yaw" and sensor.find("attach_yaw_only") is not True:
        sensor.raise_invalid("ray_alignment", "yaw")
    grid = sensor.section("pattern_cfg")
    step = grid.number("resolution")
    size = grid.numbers("size", 2)
    offset = sensor.optional_section("offset").numbers("pos", 3, 0.0)
    if not 0 < step <= min(size) or max(size) > 100 * step:
        grid.raise_invalid("resolution", "a step that gives 2 to 100 points along each side")
    x, y = (
        tuple(round(middle - side / 2 + step * index, 9) for index in range(int((side + 1e-9) / step) + 1))
        for side, middle in zip(size, offset, strict=False)
    )
    return HeightGrid(x, y, x_first=grid.find("ordering") != "yx", offset=params.number("offset", 0.5))


def _parse_gain(robot: FileSettings, joint: str, kind: str) -> float:
    """Return the stiffness, N·m/rad, or the damping, N·m·s/rad, of the joint with the name `joint`.

    `kind` is `stiffness` or `damping`. The value is taken from the first actuator of the robot with a regular
    expression that matches the joint's name. Raises PolicyError if no actuator matches.
    """
    for _, actuator in robot.section("actuators").sections():
        if any(joint_name_matches(pattern, joint) for pattern in actuator.texts(_ACTUATOR_JOINTS)):
            return actuator.joint_values(kind, (joint,))[0]
    raise PolicyError(f"no actuator in {robot.file.name} has the joint {joint}")


def _parse_action_clip(settings: FileSettings) -> Range | None:
    """Return the minimum and maximum to which rsl_rl clips raw network outputs; None: no limits.

    They are read from `agent.yaml`, the settings of the learning algorithm, next to the `env.yaml`.
    """
    file = settings.file.with_name("agent.yaml")
    if not file.is_file():
        return None
    agent = load_settings(file)
    if agent.find("clip_actions") is None:
        return None
    limit = agent.number("clip_actions")
    return -limit, limit
