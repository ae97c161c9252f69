"""MuJoCo's own batch with the features that the environment asks for."""

from mujoco.batch import Batch

from quad_env.physics.simulators import MUJOCO, SIMULATOR_FEATURES


class MujocoBatch(Batch):  # type: ignore[misc]
    """Batch of n robots that MuJoCo steps on a pool of C++ threads; see `quad_env.physics.batch.Batch`."""

    features = SIMULATOR_FEATURES[MUJOCO]
    """Features that this simulator supports."""
