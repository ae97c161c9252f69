"""View, film and recording of scenarios on the hardware profile: policies are made for this profile."""

from contextlib import closing
from pathlib import Path

import numpy as np
import pytest

from evaluate.hardware import HardwareConfig
from live.view.controller import ViewController
from live.view.requests import Request
from quad_env import SIMPLE_QUAD
from quad_env.__main__ import main
from tests.batches import begun

MAKERS = "35 N·m/rad and 0.5 N·m·s/rad"


@pytest.fixture(autouse=True)
def _soft(monkeypatch: pytest.MonkeyPatch) -> None:
    """Let SimpleQuad have built-in servos that are softer than the gains of the project's controllers."""
    robot = SIMPLE_QUAD._with(servo_stiffness=np.full(12, 35.0), servo_damping=np.full(12, 0.5))
    monkeypatch.setattr(HardwareConfig, "robot_model", property(lambda _: robot))


def test_a_view_makes_its_policies_for_the_world_that_it_goes_on_to() -> None:
    with closing(ViewController(["trot", "stand"])) as driver:

        def gains(name: str) -> tuple[str, set[str]]:
            driver.handle(Request("scenario", {"name": name}))
            return driver.sessions[0].env.robot.servo, {session.policy.robot.servo for session in driver.sessions}

        driver.handle(Request("policy", {"robot": 1, "name": "crouch"}))
        assert gains("push+hardware") == (MAKERS, {MAKERS})
        assert [session.policy.name for session in driver.sessions] == ["trot", "crouch"]
        driver.handle(Request("policy", {"robot": 0, "name": "trot_integral"}))
        assert driver.sessions[0].policy.robot.servo == MAKERS
        driver.handle(Request("alone", {}))
        assert gains("flat") == (SIMPLE_QUAD.servo, {SIMPLE_QUAD.servo})
        assert [session.policy.name for session in driver.sessions] == ["trot_integral"]


def test_a_recording_is_of_the_profile_and_the_makers_gains(tmp_path: Path) -> None:
    for name, sensed, servo in (("push", False, SIMPLE_QUAD.servo), ("push+hardware", True, MAKERS)):
        words = f"record {tmp_path}/{name}.mcap --policy trot --seconds 0.1 --scenario {name}"
        with begun() as found:
            assert main(words.split()) == 0
        assert [(batch.sensed, batch.env.robot.servo) for batch in found] == [(sensed, servo)]


@pytest.mark.rendering
def test_a_film_is_of_the_profile_and_the_makers_gains(tmp_path: Path) -> None:
    words = f"film {tmp_path}/walk.png --policies trot --seconds 0.1 --size 64 64 --scenario push+hardware"
    with begun() as found:
        assert main(words.split()) == 0
    assert [(batch.sensed, batch.env.robot.servo) for batch in found] == [(True, MAKERS)]
