"""Figures of a robot that its compiled MJCF holds."""

from functools import cache
from pathlib import Path
from typing import NamedTuple

import mujoco
import numpy as np
from numpy.typing import NDArray


class Figures(NamedTuple):
    """Joint limits and mass."""

    joint_lower: NDArray[np.float64]
    """Shape (12,), rad."""
    joint_upper: NDArray[np.float64]
    """Shape (12,), rad."""
    mass: float
    """kg"""


@cache
def figures(mjcf: Path, joint_names: tuple[str, ...]) -> Figures:
    """Figures of that model, joints in that order; KeyError for a joint that it lacks."""
    model = mujoco.MjModel.from_xml_path(str(mjcf))
    joints = [model.joint(name).id for name in joint_names]
    limits = model.jnt_range[joints].T.copy()
    limits.flags.writeable = False
    return Figures(limits[0], limits[1], float(np.round(model.body_mass.sum(), 9)))
