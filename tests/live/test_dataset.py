"""Minari datasets, read back by its library, are what the batch of the environment does with the same policy."""

import json
from pathlib import Path

import gymnasium as gym
import minari
import numpy as np
import pytest
from minari.dataset.minari_storage import MinariStorage

import policies
import quad_env
from live.__main__ import PROGRAM

NAME, POLICY, SCENARIO, SEED = "simple-quad/feedback-v0", "trot_feedback", "push=60", 4


@pytest.fixture(scope="module", autouse=True)
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    with pytest.MonkeyPatch.context() as patch:
        path = tmp_path_factory.mktemp("datasets")
        patch.setenv("MINARI_DATASETS_PATH", str(path))
        yield path


@pytest.fixture(scope="module")
def dataset(folder: Path) -> minari.MinariDataset:
    """Of an episode that ends by a fall, and of one that the time limit ends."""
    words = ["--policy", POLICY, "--scenario", SCENARIO, "--episodes", "2", "--seed", SEED, "--author", "Somebody"]
    assert PROGRAM.main(["dataset", NAME, *map(str, words)]) == 0
    return minari.load_dataset(NAME)


def test_episodes_are_to_the_bit_those_of_a_batch(dataset: minari.MinariDataset) -> None:
    vec = gym.make_vec("SimpleQuad-v0", num_envs=2, scenario=SCENARIO, autoreset_mode="DISABLED")
    policy = policies.make(POLICY)
    policy.reset(num_envs=2, seed=0)
    seen, infos = vec.reset(seed=SEED)
    episodes, running = list(dataset), np.array([True, True])
    assert [bool(episode.terminations[-1]) for episode in episodes] == [True, False]
    for number in range(1001):
        for row in np.flatnonzero(running):
            episode = episodes[row]
            assert (episode.observations[number] == seen[row]).all()
            for key in ("heading_velocity", "reward_torque", "fall"):
                assert (episode.infos[key][number] == infos[key][row]).all()
        if not running.any():
            break
        action = policy.act(seen)
        seen, rewards, terminated, truncated, infos = vec.step(action)
        for row in np.flatnonzero(running):
            episode = episodes[row]
            assert (episode.actions[number] == action[row]).all()
            ends = episode.terminations[number], episode.truncations[number]
            assert (episode.rewards[number], *ends) == (rewards[row], terminated[row], truncated[row])
        running &= ~(terminated | truncated)
    lengths = [len(episode.rewards) for episode in episodes]
    assert lengths[0] < lengths[1] == 1000
    assert [len(episode.observations) for episode in episodes] == [length + 1 for length in lengths]
    assert [len(episode.infos["fall"]) for episode in episodes] == [length + 1 for length in lengths]


def test_the_environment_it_makes_again_does_the_same_with_the_actions(dataset: minari.MinariDataset) -> None:
    env, episode = dataset.recover_environment(), dataset[0]
    assert env.unwrapped.scenario == quad_env.scenario(SCENARIO)
    [about] = dataset.storage.get_episode_metadata([0])
    observation, _ = env.reset(seed=about["seed"])
    assert (observation == episode.observations[0]).all()
    for number, action in enumerate(episode.actions):
        observation, reward, *_ = env.step(action)
        assert (observation == episode.observations[number + 1]).all()
        assert reward == episode.rewards[number]


def test_it_tells_whose_episodes_they_are(dataset: minari.MinariDataset) -> None:
    told = dataset.storage.metadata
    assert told["algorithm_name"] == POLICY
    assert told["author"] == {"Somebody"}
    assert f"{POLICY} on the scenario {SCENARIO}" in told["description"]
    assert told["policy_digest"].startswith("2-")
    assert any(requirement.startswith("mujoco==") for requirement in told["requirements"])


def test_a_name_that_is_there_is_left_as_it_is(
    dataset: minari.MinariDataset, folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    before = (folder / NAME / "data" / "metadata.json").read_bytes()
    assert PROGRAM.main(["dataset", NAME, "--episodes", "1"]) == 2
    assert "exists already" in capsys.readouterr().err
    assert (folder / NAME / "data" / "metadata.json").read_bytes() == before
    assert json.loads(before)["total_episodes"] == 2


def test_an_interrupt_while_it_is_written_leaves_none(
    folder: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def interrupted(*_: object) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr(MinariStorage, "update_metadata", interrupted)
    words = ["--policy", "stand", "--scenario", "push=150", "--episodes", "1"]
    assert PROGRAM.main(["dataset", "simple-quad/half-v0", *words]) == 130
    assert not (folder / "simple-quad" / "half-v0").exists()
    assert capsys.readouterr().err.count("\n") == 1


@pytest.mark.parametrize(
    ("name", "words", "said"),
    [
        ("stand", [], "simple-quad/trot-v0"),
        ("../../stand-v0", [], "simple-quad/trot-v0"),
        ("a-v0", ["--policy", "trott"], "trott"),
        ("a-v0", ["--scenario", "moon"], "--scenario"),
        ("a-v0", ["--scenario", "push:all"], "name one of them"),
        ("a-v0", ["--episodes", "0"], "--episodes must be"),
        ("a-v0", ["--robot", "nobody"], "--robot"),
    ],
)
def test_a_mistake_is_a_line_and_nothing_is_written(
    name: str, words: list[str], said: str, folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    before = sorted(folder.rglob("*"))
    assert PROGRAM.main(["dataset", name, *words]) == 2
    error = capsys.readouterr().err
    assert error.count("\n") == 1
    assert said in error
    assert sorted(folder.rglob("*")) == before
