"""All corrections of an external policy's specification that are tried if the policy does not walk.

A correction corrects one error, several errors in the order of the joints, or two different errors.
"""

from collections.abc import Iterator
from dataclasses import replace

from policies.external.spec import PolicySpec
from policies.external.spec_errors import actuation, joint_orders, observation
from policies.external.spec_errors.correction import PENALTIES, Correction
from quad_env.robots.robot import Robot


def corrections(spec: PolicySpec, robot: Robot, count: int = 1) -> Iterator[Correction]:
    """Yield all candidate corrections of a policy's specification; no two give the same specification.

    Args:
        spec: Specification that may have an error.
        robot: Robot that the policy moves.
        count: Number of errors that one correction corrects. With 1, each common error (COMMON_ERRORS) is corrected
            alone. With more than 1, this number of errors in the order of the joints is corrected together, because
            the joint orders of Isaac Lab and Unitree differ by several errors.

    Yields:
        Correction with its penalty.
    """
    known_specs = [spec]
    for correction in _all_corrections(spec, robot, count):
        if correction.spec not in known_specs:
            known_specs.append(correction.spec)
            yield replace(correction, penalty=correction.penalty + PENALTIES.get(correction.error, 0.0))


def second_corrections(first: Correction, robot: Robot) -> Iterator[Correction]:
    """Yield combinations of a given correction with a second correction, of another error.

    Args:
        first: Given correction.
        robot: Robot that the policy moves.

    Yields:
        Correction that combines both corrections, with the sum of their penalties.
    """
    for second in corrections(first.spec, robot):
        if second.error != first.error:
            yield Correction(
                f"{first.error} and {second.error}",
                f"{first.changed_setting} and {second.changed_setting}",
                f"{first.keys_to_correct} and {second.keys_to_correct}",
                second.spec,
                first.penalty + second.penalty,
            )


def _all_corrections(spec: PolicySpec, robot: Robot, count: int) -> Iterator[Correction]:
    yield from joint_orders.reorder_joints(spec, robot, count)
    if count > 1:
        return
    yield from observation.change_frames(spec)
    yield from observation.reverse_gravity(spec)
    yield from observation.change_scales(spec)
    yield from actuation.change_actions(spec)
    yield from actuation.change_rate(spec)
    yield from observation.change_history(spec)
    yield from observation.change_conventions(spec)
    yield from observation.change_term_order(spec)
    yield from actuation.change_signs(spec, robot)
    yield from joint_orders.reorder_observed_joints(spec, robot)
    yield from actuation.change_gains(spec, robot)
