"""MuJoCo's own batch as a simulator of the environment."""

from mujoco.batch import Batch

from quad_env.physics.simulators import MUJOCO, SIMULATOR_FEATURES


class MujocoBatch(Batch):  # type: ignore[misc]
    """n robots that MuJoCo steps on a pool of C++ threads; see `quad_env.physics.batch.Batch`."""

    features = SIMULATOR_FEATURES[MUJOCO]
    """Features that this simulator supports."""
