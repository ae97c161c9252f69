"""The command map of a gait: fitted to the robot's response, so that it achieves what it is commanded."""

from dataclasses import replace
from typing import TypeVar

import numpy as np

from policies.base import Floats
from policies.gaits.parameters import GaitParameters
from policies.trot.open_loop import TrotParameters

WEAKEST_RESPONSE = 0.7
"""Achieved per commanded velocity below which a candidate costs more, so that standing still does not win."""
WEAKNESS_WEIGHT = 10.0

G = TypeVar("G", TrotParameters, GaitParameters)


def response(command: Floats, velocity: Floats) -> Floats:
    """Least-squares map (4, 3) from commands (n, 3) and 1 to achieved velocities (n, 3)."""
    inputs = np.column_stack((command, np.ones(len(command))))
    return np.linalg.lstsq(inputs, velocity, rcond=None)[0].astype(np.float64)


def weakness(found: Floats) -> float:
    """Cost of a response (4, 3) whose velocities are too small compared with the commanded ones."""
    return WEAKNESS_WEIGHT * float(np.clip(WEAKEST_RESPONSE - np.diag(found[:3]), 0.0, None).sum())


def undone(parameters: G, found: Floats) -> G:
    """The same gait with the command map that undoes the response `found`, (4, 3), to the map in force.

    With u asked of the gait and v achieved: forward v = a u + b, lateral v = a u, yaw rate ω = a u + c u_lateral.
    Raises ValueError where the response is too weak for the parameters' limits.
    """
    return replace(
        parameters,
        forward_gain=parameters.forward_gain / found[0, 0],
        forward_bias=parameters.forward_bias - parameters.forward_gain * found[3, 0] / found[0, 0],
        lateral_gain=parameters.lateral_gain / found[1, 1],
        yaw_gain=parameters.yaw_gain / found[2, 2],
        yaw_per_lateral=(parameters.yaw_per_lateral - parameters.yaw_gain * found[1, 2] / found[2, 2]) / found[1, 1],
    )
