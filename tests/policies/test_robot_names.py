"""Every function that takes a robot also takes its name."""

from collections.abc import Callable
from functools import partial
from pathlib import Path

import pytest

import policies
import quad_env
from policies.article import Document
from policies.gaits.policy import Gaits
from policies.mpc.policy import Mpc, MpcWbc
from policies.mpc.sighted import SightedMpcWbc
from policies.safety import SafetyLimits
from policies.trot.integral import TrotIntegral
from policies.trot.reference import TrotReference
from policies.virtual_model.policy import TrotFeedback
from tests.robot_models import NEEDS_MODELS

MAKERS: dict[str, Callable[..., object]] = {
    kind.__name__: kind
    for kind in (
        *(policies.Trot, policies.Stand, policies.Behaviour, Document, TrotIntegral, TrotFeedback, Gaits),
        *(Mpc, MpcWbc, SightedMpcWbc, TrotReference, quad_env.HomePoseSpace, SafetyLimits.for_robot),
    )
} | {
    "make": partial(policies.make, "trot"),
    "resolve": partial(policies.resolve, "trot"),
    "scenario": partial(quad_env.scenario, "push:3"),
}


@pytest.mark.parametrize("make", MAKERS.values(), ids=MAKERS)
def test_an_unknown_name_is_said_with_those_that_there_are(make: Callable[..., object]) -> None:
    with pytest.raises(ValueError, match="unknown robot 'nobody'; there are simple_quad, "):
        make(robot="nobody")
    make(robot="simple_quad")


@NEEDS_MODELS
@pytest.mark.parametrize("make", [policies.Trot, MpcWbc], ids=lambda kind: kind.__name__)
def test_a_policy_is_made_for_the_robot_of_a_name(make: Callable[..., policies.Policy]) -> None:
    assert make(robot="go1").robot == quad_env.ROBOTS["go1"]


def test_a_policy_is_loaded_for_the_robot_of_a_name(repository: Path) -> None:
    folder = repository / "models" / "residual"
    assert policies.load(folder, robot="simple_quad").robot == quad_env.SIMPLE_QUAD
    with pytest.raises(ValueError, match="unknown robot 'nobody'"):
        policies.load(folder, robot="nobody")
