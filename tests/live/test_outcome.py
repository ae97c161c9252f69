"""The outcome so far is the outcome that the evaluator gives the same episode when it ends there."""

import numpy as np
import pytest

import policies
import quad_env
from evaluate.measures.metrics import outcome
from evaluate.rollouts.rollout import roll_out, run
from live.outcome import OutcomeSoFar
from live.session import Session
from policies.base import Policy


@pytest.mark.parametrize(
    ("policy", "scenario"), [("stand", "slow=0.05"), ("trot_feedback", "flat"), ("document", "flat")]
)
def test_at_the_end_of_an_episode_it_is_the_outcome_of_the_evaluation(policy: str, scenario: str) -> None:
    seeds, so_far, found = np.arange(2), OutcomeSoFar(), quad_env.scenario(scenario)
    roll_out(policies.make(policy), found, seeds, so_far, steps=620, terminate_on_fall=False)
    judged = outcome(run(policies.make(policy), found, seeds, steps=620))
    assert so_far.words() == [each.replace("_", " ") for each in judged]


def test_it_follows_commands_given_by_hand() -> None:
    so_far = OutcomeSoFar()
    live = Session([policies.make("trot"), policies.make("stand")], "flat", seed=1, observers=[so_far])
    live.steer((0.5, 0.0, 0.0))
    for _ in range(90):
        live.step()
    assert so_far.words() == ["upright", "upright"]
    for _ in range(150):
        live.step()
    assert so_far.words() == ["succeeded", "stalled"]
    live.reset()
    assert so_far.words() == ["upright", "upright"]
    live.close()


def judged(velocities: np.ndarray, commands: tuple[float, ...] | np.ndarray = (0.5, 0.0, 0.0), fallen: int = -1) -> str:
    """Outcome of one robot with these velocities in the heading frame, (steps, 3), down in one step; 10 ms steps, and
    commands that are drawn every 5 s."""
    so_far = OutcomeSoFar()
    so_far.begin(1, 0.01, 500)
    commands = np.broadcast_to(commands, velocities.shape)
    for number, (command, velocity) in enumerate(zip(commands, velocities, strict=True)):
        so_far.add(command[None], velocity[None], np.array([number == fallen]), np.array([False]))
    return so_far.words()[0]


def walk(*stretches: tuple[int, float]) -> np.ndarray:
    """So many steps at so many m/s forward, one after the other."""
    return np.concatenate([np.tile([speed, 0.0, 0.0], (steps, 1)) for steps, speed in stretches])


def test_the_first_second_of_a_command_is_not_judged() -> None:
    assert judged(walk((100, -2.0), (400, 0.5), (100, -2.0), (400, 0.5))) == "succeeded"
    assert judged(walk((101, -120.0), (400, 0.5))) == "off command"
    assert judged(walk((100, 0.0), (400, 0.26))) == "succeeded", "0.24 m/s off, where 0.25 are allowed"


def test_every_interval_is_judged_by_itself_though_the_command_stays() -> None:
    assert judged(walk((500, 0.2), (500, 0.8))) == "off command"
    assert judged(walk((1000, 0.5))) == "succeeded"


def test_a_command_that_changes_begins_an_interval() -> None:
    commands = walk((300, 0.5), (300, -0.5))
    assert judged(walk((300, 0.5), (100, 0.5), (200, -0.5)), commands) == "succeeded"


def test_who_fell_has_fallen_though_it_gets_up_and_who_stands_has_stalled() -> None:
    assert judged(walk((600, 0.5)), fallen=300) == "fell"
    assert judged(walk((500, 0.0))) == "stalled"
    assert judged(walk((500, 0.0)), (0.1, 0.0, 0.0)) == "stalled"
    assert judged(walk((500, 0.0)), (0.0, 0.0, 0.0)) == "succeeded"
    assert judged(walk((100, 0.5))) == "upright"


def test_intervals_weigh_by_their_length() -> None:
    """Four counted seconds in which it does not turn and one in which it does: a fifth of the commanded turn."""
    turning = np.array([[0.0, 0.0, 1.0]])
    commands = np.concatenate([turning] * 500 + [-turning] * 200)
    assert judged(np.concatenate([0.0 * turning] * 500 + [-turning] * 200), commands) == "stalled"
    assert judged(np.concatenate([turning] * 500 + [-0.0 * turning] * 200), commands) == "off command"


class Fails(Policy):
    """Stands; from a step on it counts as a user's policy that has failed."""

    def __init__(self, step: int) -> None:
        super().__init__()
        self.name, self._step = "fails", step

    def _allocate(self, num_envs: int) -> None:
        self.failure: list[str | None] = [None] * num_envs
        self._steps = 0

    def _act(self, observation):
        self._steps += 1
        if self._steps >= self._step:
            self.failure = ["raised ValueError: no"] * len(observation)
        return np.tile(self.robot.home_pose, (len(observation), 1)).astype(np.float32)


def test_a_policy_that_failed_is_said_though_its_robot_stands() -> None:
    so_far = OutcomeSoFar()
    live = Session([Fails(50), policies.make("stand"), Fails(150)], "flat", seed=1, observers=[so_far])
    live.steer((0.0, 0.0, 0.0))
    for _ in range(60):
        live.step()
    assert so_far.words() == ["policy error", "upright", "upright"]
    for _ in range(100):
        live.step()
    assert so_far.words() == ["policy error", "succeeded", "policy error"]
    live.close()
