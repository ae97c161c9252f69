"""Unitree's `deploy.yaml`, which unitree_rl_lab and unitree_rl_mjlab export next to a network.

Sources: unitree_rl_lab `utils/export_deploy_cfg.py` and `deploy/include/isaaclab`. Joint i of the policy is motor
`joint_ids_map[i]` of Unitree's SDK; gains are in the order of the motors, all else in that of the policy. Terms are
clipped, then scaled, unless `scale_first`; `use_gym_history` puts a history by time, oldest first.
"""

from dataclasses import replace

from policies.base import PolicyError
from policies.foreign.description import Numbers, PolicyDescription, Range, Term
from policies.foreign.readers.isaac_terms import OF_JOINTS, history_of, term
from policies.foreign.readers.joint_orders import UNITREE_MOTORS, Joints
from policies.foreign.readers.networks import exported
from policies.foreign.readers.settings import Settings


def describe(settings: Settings) -> PolicyDescription:
    """The policy of a `deploy.yaml`. Raises PolicyError."""
    motors = settings.order("joint_ids_map")
    actions = settings.inside("actions")
    if list(actions.values) != ["JointPositionAction"]:
        raise settings.wrong("actions", "JointPositionAction alone")
    action = actions.inside("JointPositionAction")
    order = action.order("joint_ids") if action.find("joint_ids") is not None else tuple(range(12))
    asset = tuple(UNITREE_MOTORS[motor] for motor in motors)

    def of_motors(key: str) -> Numbers:
        values = settings.numbers(key)
        return tuple(values[motors[each]] for each in order)

    group = _group(settings)
    observed, terms = _terms(group, asset)
    joints = tuple(asset[each] for each in order)
    default = tuple(settings.numbers("default_joint_pos")[each] for each in order)
    offset = action.numbers("offset") if action.find("offset") is not None else (0.0,) * 12
    return PolicyDescription(
        network=exported(settings.file),
        control_rate=1 / settings.number("step_dt"),
        joints=joints,
        default_position=default,
        action_scale=action.numbers("scale") if action.find("scale") is not None else (1.0,) * 12,
        action_offset=offset if offset != default else None,
        target_clip=_clip(action),
        stiffness=of_motors("stiffness"),
        damping=of_motors("damping"),
        terms=terms,
        observed_joints=observed if observed != joints else None,
        history_layout="time" if group.find("use_gym_history") else "term",
    )


def _group(settings: Settings) -> Settings:
    """The observations of the only input."""
    observations = settings.inside("observations")
    groups = [(name, group) for name, group in observations.groups()]
    if not groups or "params" in groups[0][1].values:
        return observations
    if len(groups) > 1:
        raise PolicyError(f"`observations` has the inputs {', '.join(name for name, _ in groups)}: one is read")
    return groups[0][1]


def _terms(group: Settings, asset: Joints) -> tuple[Joints, tuple[Term, ...]]:
    """Order of the observed joints, and the terms."""
    terms, orders = [], set()
    for name, settings in group.groups():
        found = term(name, settings, history_of(settings))
        terms.append(_clipped_last(found) if group.find("scale_first") else found)
        if found.name in OF_JOINTS:
            orders.add(_observed(settings, asset))
    if len(orders) > 1:
        raise PolicyError("the joints are observed in several orders (`asset_cfg.joint_ids`): one is read")
    return (orders or {asset}).pop(), tuple(terms)


def _observed(settings: Settings, asset: Joints) -> Joints:
    params = settings.inside("params")
    if params.find("asset_cfg") is None or params.inside("asset_cfg").find("joint_ids") is None:
        return asset
    return tuple(asset[each] for each in params.inside("asset_cfg").order("joint_ids"))


def _clipped_last(term: Term) -> Term:
    """The same term, with a clip before its scale."""
    if term.clip is None:
        return term
    if len(set(term.scale)) > 1 or term.scale[0] <= 0:
        raise PolicyError(f"`scale_first` with a clip needs one positive scale for all numbers of {term.name}")
    return replace(term, clip=(term.clip[0] / term.scale[0], term.clip[1] / term.scale[0]))


def _clip(action: Settings) -> tuple[Range, ...] | None:
    """Ranges of the targets, rad."""
    if (clip := action.find("clip")) is None:
        return None
    if not isinstance(clip, list):
        raise action.wrong("clip", "12 ranges")
    ranges = Settings(dict(enumerate(clip)), action.file, f"{action.above}clip.")
    return tuple((found[0], found[1]) for found in (ranges.numbers(each, 2) for each in ranges.values))
