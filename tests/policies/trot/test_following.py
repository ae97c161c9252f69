"""How far joints follow their targets: what is measured, and what is not."""

import numpy as np

from policies.trot.perception import Following

JOINTS, STEPS = 12, 200


def followed(share, delay=0, walking=1.0):
    """After strides whose joints move by that share of their targets' movement, that many control periods late."""
    following = Following(JOINTS, 0.01)
    walks = np.array([walking])
    for step in range(STEPS):
        targets = 0.3 * np.sin(0.3 * step + np.arange(JOINTS))[:, None]
        late = 0.3 * np.sin(0.3 * (step - delay) + np.arange(JOINTS))[:, None]
        following.read(share * late, walks)
        following.command(targets, walks)
    return following


def test_the_ratio_is_that_of_the_movements_however_late_the_joints_are():
    for share in (0.1, 0.5, 1.0):
        for delay in (0, 1, 8):
            assert abs(followed(share, delay).ratio[0] - share) <= 0.02, (share, delay)


def test_what_a_robot_does_while_it_does_not_walk_teaches_nothing():
    assert followed(0.1, walking=0.0).ratio[0] == 1.0


def test_a_robot_alone_has_the_same_bits_as_among_others():
    strides = np.random.default_rng(0).normal(size=(20, JOINTS, 3))

    def ratio(strides):
        following, walks = Following(JOINTS, 0.01), np.ones(strides.shape[2])
        following.reset(strides.shape[2])
        for targets, joints in zip(strides[::2], strides[1::2], strict=True):
            following.read(joints, walks)
            following.command(targets, walks)
        return following.ratio

    assert [ratio(strides[:, :, [robot]])[0] for robot in range(3)] == ratio(strides).tolist()
