"""Height of the trunk above the feet that stand."""

import numpy as np

from quad_env.envs.vector_env import SimpleQuadVectorEnv
from quad_env.robots.kinematics import foot_jacobians, foot_positions
from quad_env.robots.simple_quad import SIMPLE_QUAD as ROBOT
from quad_env.sensing.error_state import FEET, BodyMotion, corrected, size
from quad_env.sensing.estimators import KALMAN
from quad_env.sensing.trunk_height import TrunkHeight

DT = 0.01
JOINTS = ROBOT.home_pose.reshape(1, 4, 3)
ROW = np.arange(1)


def motion(velocity: float = 0.0, height: float = 0.4) -> BodyMotion:
    """Level, with the feet's lowest points that far below the trunk's centre, m, which rises with that velocity."""
    feet = ROBOT.hip_positions + foot_positions(ROBOT, JOINTS)
    feet[..., 2] = ROBOT.foot_radius - height
    still = np.zeros((1, 3))
    return BodyMotion(np.array([[0.0, 0.0, -1.0]]), np.array([[0.0, 0.0, velocity]]), still, still, feet)


def begun(covariance: np.ndarray, zero: float = 0.0, at: BodyMotion | None = None) -> TrunkHeight:
    made = TrunkHeight(ROBOT, 1, zero)
    made.begin(ROW, at or motion(), covariance, foot_jacobians(ROBOT, JOINTS))
    return made


def test_it_is_that_of_the_feet_that_stand() -> None:
    covariance = np.zeros((1, size(ROBOT), size(ROBOT)))
    made, now = begun(covariance), motion()
    now.feet[0, :2, 2] += 0.1  # two feet in the air
    made.move_on(ROW, now, covariance, np.array([[0.0, 0.0, 1.0, 1.0]]), foot_jacobians(ROBOT, JOINTS), DT)
    np.testing.assert_allclose(made.now.value, [0.4], atol=1e-12)


def test_in_the_air_it_goes_on_by_the_velocity() -> None:
    covariance = np.zeros((1, size(ROBOT), size(ROBOT)))
    covariance[0, 3:6, 3:6] = 0.04 * np.eye(3)
    made, feet = begun(covariance), foot_jacobians(ROBOT, JOINTS)
    for _ in range(5):
        made.move_on(ROW, motion(0.6), covariance, np.zeros((1, 4)), feet, DT)
    np.testing.assert_allclose(made.now.value, [0.4 + 5 * DT * 0.6])
    np.testing.assert_allclose(made.now.deviation, [5 * DT * 0.2])


def test_what_is_claimed_follows_from_the_errors_of_tilt_and_feet() -> None:
    """Against the spread of heights of motions whose errors are drawn from the covariance."""
    random = np.random.default_rng(0)
    mixing = np.zeros((size(ROBOT), size(ROBOT)))
    mixing[:3, :3], mixing[FEET, FEET] = 0.03 * np.eye(3), 0.002 * random.normal(size=(12, 12))
    covariance = (mixing @ mixing.T)[None]
    at = motion()
    at.feet[0, :, 0] += 0.2  # a trunk that hangs behind its feet is felt to sink as it pitches
    claimed = begun(covariance, at=at).now.deviation[0]
    drawn = [corrected(at, (mixing @ random.normal(size=size(ROBOT)))[None]) for _ in range(4000)]
    heights = [begun(0.0 * covariance, at=each).now.value[0] for each in drawn]
    np.testing.assert_allclose(np.std(heights), claimed, rtol=0.05)


def test_encoders_whose_zeros_are_off_make_it_doubtful() -> None:
    covariance, random = np.zeros((1, size(ROBOT), size(ROBOT))), np.random.default_rng(1)
    claimed = begun(covariance, zero=0.005).now.deviation[0]
    off = JOINTS + 0.005 * random.normal(size=(4000, 4, 3))
    heights = -(ROBOT.hip_positions + foot_positions(ROBOT, off))[..., 2].mean(axis=1)
    np.testing.assert_allclose(np.std(heights), claimed, rtol=0.05)


def test_a_standing_robot_knows_how_high_it_stands() -> None:
    vec = SimpleQuadVectorEnv(4, sensors="typical", estimator=KALMAN, readings=True)
    vec.reset(seed=[1, 2, 3, 4])
    stand = np.tile(ROBOT.home_pose, (4, 1)).astype(np.float32)
    for _ in range(150):
        infos = vec.step(stand)[4]
    assert vec.estimator is not None
    height = vec.estimator.height
    assert height is not None
    assert (np.abs(height.value - infos["height"]) < 3.0 * height.deviation).all()
    assert (height.deviation < 0.004).all()
