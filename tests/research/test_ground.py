"""Success on two sets of surfaces."""

import numpy as np

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


def test_the_other_ground_is_as_rough_on_another_field() -> None:
    here, there = SCENARIOS["rough"], ground.elsewhere(SCENARIOS["rough"], 3)
    assert (here.terrain.seed, there.terrain.seed) == (0, 3)
    assert here.terrain.peak_to_valley == there.terrain.peak_to_valley
    assert ground.elsewhere(SCENARIOS["flat"], 3) is SCENARIOS["flat"]
