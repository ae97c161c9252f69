"""The jump as it is measured: rise, landing, and who did not land."""

import numpy as np

from policies.base import CONTROL_PERIOD
from policies.behaviour import Behaviour
from policies.behaviour.motion import Jump, keyframes_of
from quad_env.physics.simulation import ALL, Simulation
from quad_env.robots.simple_quad import SIMPLE_QUAD
from quad_env.seeding import episode_seeds
from research.studies.jump import jumped, report


def jump(keyframes=None, count=16):
    """Outcome and policy of jumps through those keyframes."""
    policy = Behaviour(follow=False)
    policy._motions = tuple(
        (s, Jump(SIMPLE_QUAD, CONTROL_PERIOD, keyframes) if isinstance(m, Jump) else m) for s, m in policy._motions
    )
    return jumped(policy, episode_seeds("search", 9, count)), policy


def test_jump_rises_and_lands_standing() -> None:
    outcome, policy = jump()
    assert outcome.rise.min() >= 0.15
    assert outcome.peak_torque <= SIMPLE_QUAD.rated_torque
    assert outcome.stands.all()
    assert {change.reason for change in policy.machine.changes()} == {"jump requested", "landed"}
    assert "landed standing: 16 of 16" in report(outcome)


def test_a_jump_without_a_thrust_does_not_rise() -> None:
    crouch, *_, stand = keyframes_of(SIMPLE_QUAD)
    outcome, _ = jump((crouch, stand), count=2)
    assert outcome.rise.max() < 0.05
    assert "landed standing: 0 of 2" in report(outcome)


def test_a_robot_whose_simulation_diverges_in_the_air_has_not_landed(monkeypatch) -> None:
    """It is parked in the home pose, where it looks as if it stood."""
    found = Simulation.diverged

    def first_one_diverges(self, ids=ALL):
        first = np.arange(len(self.qpos))[ids] == 0
        return found(self, ids) | (first & (self.qpos[ids, 2] > SIMPLE_QUAD.home_height + 0.16))

    monkeypatch.setattr(Simulation, "diverged", first_one_diverges)
    outcome, _ = jump(count=2)
    assert outcome.rise.min() >= 0.15
    assert outcome.stands.tolist() == [False, True]
    assert "landed standing: 1 of 2" in report(outcome)
