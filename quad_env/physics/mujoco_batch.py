"""Interface to MuJoCo: MuJoCo's class `Batch` with the list of supported features."""

from mujoco.batch import Batch

from quad_env.physics.simulators import MUJOCO, SIMULATOR_FEATURES


class MujocoBatch(Batch):  # type: ignore[misc]
    """Batch of n robots that MuJoCo steps on C++ threads; `quad_env.physics.batch.Batch` is the interface."""

    features = SIMULATOR_FEATURES[MUJOCO]
    """Features of the environment that MuJoCo supports."""
