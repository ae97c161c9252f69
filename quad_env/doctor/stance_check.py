"""Check for the commands `doctor` and `describe` that a robot stands in simulation.

If it does not stand, the finding contains the likely cause and a remedy.
"""

from quad_env.doctor.causes import diagnose
from quad_env.doctor.check import DoctorSubject, Finding, ok, problem
from quad_env.doctor.stance import measure_stance


def stands(subject: DoctorSubject) -> Finding:
    """Check that the robot stands in simulation.

    In the stance test, the joints have to hold their targets under the robot's weight, and come to rest after a squat.
    """
    env = subject.env
    robot = env.robot
    stance = measure_stance(env)
    if (fault := stance.fault) is not None:
        return problem(fault, *diagnose(subject, stance))
    share = 100.0 * stance.torque / robot.rated_torque
    return ok(f"{stance.trunk_text}; {stance.tracking_text}, with {share:.0f} % of the largest torque")
