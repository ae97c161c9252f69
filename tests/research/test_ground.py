"""Success on two sets of surfaces."""

import numpy as np
import pytest

from quad_env.cli.command_line import UsageError
from quad_env.scenarios.named import SCENARIOS
from research.studies import ground


def pair(here: int, there: int, count: int = 64) -> ground.Pair:
    return ground.Pair("trot", "rough", np.arange(count) < here, np.arange(count) < there)


def test_shares_agree_where_each_lies_within_the_interval_of_the_other() -> None:
    assert pair(32, 36).agrees  # Wilson's intervals of 50 % and 56 % are ±12 points
    assert not pair(32, 44).agrees
    assert not pair(3, 0).agrees, "0 % is within no interval of 3 of 64, [1.6, 12.9]"


def test_a_policy_that_hangs_on_the_ground_is_found_out(monkeypatch, capsys) -> None:
    """Planted: one that succeeds on the surfaces of the evaluation alone."""

    def by_heart(policy, scenario, seeds, threads):
        return np.full(len(seeds), policy == "stand" or scenario.terrain.seed == 0)

    monkeypatch.setattr(ground, "succeeded", by_heart)
    assert ground.main(ground.Options(policies=("trot", "stand"), scenarios=("rough",), episodes=16)) == 1
    assert "95 % interval: 1 of 2" in capsys.readouterr().out
    assert ground.main(ground.Options(policies=("stand",), scenarios=("rough",), episodes=16)) == 0


def test_real_episodes_are_the_same_seeds_on_another_field(monkeypatch) -> None:
    seen = []
    real = ground.run

    def brief(policy, scenario, seeds, **settings):
        seen.append((scenario.terrain.seed, scenario.terrain.peak_to_valley, seeds.tolist()))
        return real(policy, scenario, seeds, steps=120, **settings)

    monkeypatch.setattr(ground, "run", brief)
    (found,) = ground.pairs(ground.Options(policies=("stand",), episodes=2, threads=1), [SCENARIOS["rough"]])
    assert len(found.here) == len(found.there) == 2
    (a, b) = seen
    assert (a[0], b[0]) == (0, 3)
    assert a[1:] == b[1:]


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (ground.Options(scenarios=("flat",)), "the ground of flat is not random"),
        (ground.Options(scenarios=("moon",)), "--scenarios: unknown scenario 'moon'"),
        (ground.Options(other=0), "is the ground of rough itself"),
    ],
)
def test_what_cannot_be_compared_is_said(options, words) -> None:
    with pytest.raises(UsageError, match=words):
        ground.main(options)
