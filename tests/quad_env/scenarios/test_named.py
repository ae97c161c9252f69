"""Scenarios as they are written: one reading of them, for environments and for commands."""

import gymnasium as gym
import pytest

from evaluate.rollouts import battery
from quad_env import ENV_ID


@pytest.mark.parametrize("written", ["push", "push:3", "push=42", "payload=15+slope=10"])
def test_an_environment_takes_every_scenario_that_commands_take(written: str) -> None:
    wanted = battery.one(written)
    with gym.make(ENV_ID, scenario=written) as env:
        assert env.unwrapped.scenario == wanted
    robots = gym.make_vec(ENV_ID, num_envs=2, scenario=written)
    assert robots.unwrapped.scenario == wanted
    robots.close()


@pytest.mark.parametrize(
    ("written", "words"),
    [
        ("flatt", "valid: flat, push, .*surprise, slow, a level .* push:3, severities .* payload=15.slope=10"),
        ("pushh:3", "unknown scenario 'pushh:3'; valid: flat, push"),
        ("push:9", "push has levels 1 to 8, not 9"),
        ("push:hard", "valid: push:1 to push:8"),
        ("push:all", "'push:all' is no level of push; valid: push:1 to push:8"),
        ("quick", "unknown scenario 'quick'; valid: flat"),
        (3, "unknown scenario 3; valid: flat"),
    ],
)
def test_what_is_no_scenario_is_a_value_error_with_the_valid_names(written: str, words: str) -> None:
    with pytest.raises(ValueError, match=words):
        gym.make(ENV_ID, scenario=written)
