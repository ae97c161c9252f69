"""Unitree's `deploy.yaml`, which unitree_rl_lab and unitree_rl_mjlab export next to a network.

Sources: unitree_rl_lab `utils/export_deploy_cfg.py` and `deploy/include/isaaclab`. Joint i of the policy is motor
`joint_ids_map[i]` of Unitree's SDK; gains are in the order of the motors, all else in that of the policy. Terms are
clipped, then scaled, unless `scale_first`; `use_gym_history` puts a history by time, oldest first.
"""

from dataclasses import replace

from policies.base import PolicyError
from policies.external.readers.isaac_terms import incomplete_remarks, make_term, observed_order
from policies.external.readers.joint_orders import UNITREE_MOTORS, JointNames
from policies.external.readers.settings import FileSettings
from policies.external.spec import ObservationTerm, PolicySpec, Range


def parse_spec(settings: FileSettings) -> PolicySpec:
    """The policy of a `deploy.yaml`. Raises PolicyError."""
    actions, motors = settings.section("actions"), settings.permutation("joint_ids_map")
    if list(actions.values) != ["JointPositionAction"]:
        raise settings.invalid_value("actions", "JointPositionAction alone")
    action = actions.section("JointPositionAction")
    order = action.permutation("joint_ids", optional=True)
    asset = tuple(UNITREE_MOTORS[motor] for motor in motors)
    joints = _ordered(asset, action)
    stiffness, damping, default = (settings.numbers(key) for key in ("stiffness", "damping", "default_joint_pos"))
    default = tuple(default[each] for each in order)
    offset = action.numbers("offset", default=0.0)
    group = _group(settings)
    terms = {name: _term(name, each, bool(group.find("scale_first"))) for name, each in group.sections()}
    observed = observed_order(
        terms, lambda name: _ordered(asset, group.section(name).optional_section("params", "asset_cfg"))
    )
    return PolicySpec(
        network=settings.network(),
        control_rate=1 / settings.number("step_dt"),
        joints=joints,
        default_position=default,
        action_scale=action.numbers("scale", default=1.0),
        action_offset=offset if offset != default else None,
        target_clip=_clip(action),
        stiffness=tuple(stiffness[motors[each]] for each in order),
        damping=tuple(damping[motors[each]] for each in order),
        terms=tuple(terms.values()),
        observed_joints=observed if observed != joints else None,
        history_layout="time" if group.find("use_gym_history") else "term",
        remarks=incomplete_remarks(group.sections()),
    )


def _group(settings: FileSettings) -> FileSettings:
    """The observations of the only input."""
    observations = settings.section("observations")
    groups = [group for _, group in observations.sections()]
    if not groups or "params" in groups[0].values:
        return observations
    if len(groups) > 1:
        raise settings.invalid_value("observations", "those of one input")
    return groups[0]


def _term(name: str, settings: FileSettings, scale_first: bool) -> ObservationTerm:
    found = make_term(name, settings)
    if not scale_first or found.clip is None:
        return found
    if len(found.scale) > 1 or found.scale[0] <= 0:
        raise PolicyError(f"`scale_first` with a clip needs one positive scale for all numbers of {name}")
    return replace(found, clip=(found.clip[0] / found.scale[0], found.clip[1] / found.scale[0]))


def _ordered(asset: JointNames, settings: FileSettings) -> JointNames:
    return tuple(asset[each] for each in settings.permutation("joint_ids", optional=True))


def _clip(action: FileSettings) -> tuple[Range, ...] | None:
    """Ranges of the targets, rad."""
    if (clip := action.find("clip")) is None:
        return None
    if not isinstance(clip, list):
        raise action.invalid_value("clip", "12 ranges")
    ranges = FileSettings(dict(enumerate(clip)), action.file, f"{action.key_prefix}clip.")
    return tuple(map(ranges.range, ranges.values))
