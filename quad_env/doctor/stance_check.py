"""Check that the robot stands; the named remedy is one with which it stood, see `causes`."""

from quad_env.doctor.causes import diagnosis
from quad_env.doctor.check import Finding, Subject, ok, problem
from quad_env.doctor.stance import stance_of


def stands(subject: Subject) -> Finding:
    """Whether the joints hold their targets under the robot's weight and come to rest, and the robot stands."""
    env = subject.env
    robot = env.robot
    stance = stance_of(env)
    if (fault := stance.fault) is not None:
        return problem(fault, *diagnosis(subject, stance))
    share = 100.0 * stance.torque / robot.rated_torque
    return ok(f"{stance.trunk}; {stance.held}, with {share:.0f} % of the largest torque")
