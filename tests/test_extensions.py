"""Extensions: a package outside of the clone, installed by pip, adds each kind of entry; invalid ones are named."""

import json
import os
import subprocess
import sys
from pathlib import Path

import gymnasium as gym
import numpy as np
import pyarrow.parquet as pq
import pytest

import policies
import quad_env
from evaluate.cells import EpisodeChunk, LabelledPolicy, Task
from evaluate.hardware import IDEAL
from evaluate.measures.episodes import Episodes
from evaluate.measures.extra import ExtraMeasure
from evaluate.rollouts import workers
from evaluate.rollouts.run import simulate
from quad_env.cli.command_line import UsageError
from quad_env.extensions import Extension
from tests.test_docs import PAGES, blocks, file_name
from train.commands.run import parse
from train.training_robots import make_robots

FloatArray = np.ndarray[tuple[int, ...], np.dtype[np.float64]]

ROOT = Path(__file__).parents[1]
PROJECT = """
[build-system]
requires = ["hatchling"]
build-backend = "hatchling.build"

[project]
name = "my-project"
version = "1.0"

[project.entry-points.quad_env]
my_project = "my_project.quadruped:EXTENSION"
broken = "my_project.missing:EXTENSION"

[tool.hatch.build.targets.wheel]
packages = ["my_project"]
"""
USE = """
import gymnasium as gym, json, sys, warnings
with warnings.catch_warnings(record=True) as caught:
    warnings.simplefilter("always")
    import policies, quad_env
    env = gym.make("quad_env:SimpleQuad-v0", robot="my_quad", scenario="heavy_ice:2",
                   rewards={"height_error": -2.0}, observations=("horizontal_speed",))
observation, _ = env.reset(seed=0)
observation, *_, info = env.step(env.action_space.sample())
print(json.dumps({
    "term": observation[-2:].tolist(), "velocity": info["heading_velocity"][:2].tolist(),
    "reward": float(info["reward_height_error"]), "robot": env.unwrapped.robot.name,
    "payload": env.unwrapped.scenario.payload.mass, "policy": policies.make("patient", robot="my_quad").name,
    "calm": quad_env.scenario("calm").name, "warnings": [str(each.message) for each in caught],
}))
"""


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Folder into which pip has installed the package of docs/extending.md."""
    folder = tmp_path_factory.mktemp("project")
    package = folder / "my_project"
    package.mkdir()
    (folder / "pyproject.toml").write_text(PROJECT, encoding="utf-8")
    (package / "__init__.py").write_text("", encoding="utf-8")
    (block,) = (each for each in blocks("python", PAGES["docs/extending.md"]) if file_name(each))
    (package / "quadruped.py").write_text(block, encoding="utf-8")
    target = folder / "site"
    options = ["--quiet", "--no-deps", "--no-build-isolation", "--no-index", "--target", str(target), str(folder)]
    subprocess.run([sys.executable, "-m", "pip", "install", *options], check=True, timeout=300)
    return target


def run(site: Path, *command: str, cwd: Path) -> subprocess.CompletedProcess[str]:
    """Run a Python command with the installed package, outside of the clone."""
    path = os.pathsep.join((str(site), str(ROOT)))
    environment = os.environ | {"PYTHONPATH": path}
    return subprocess.run(
        [sys.executable, *command], cwd=cwd, env=environment, capture_output=True, text=True, timeout=600, check=False
    )


def test_installed_package_adds_reward_observation_axis_scenario_robot_and_policy(site: Path, tmp_path: Path) -> None:
    done = run(site, "-c", USE, cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    seen = json.loads(done.stdout)
    assert seen["term"] == pytest.approx(seen["velocity"], rel=1e-6)
    assert seen["reward"] < 0.0
    assert (seen["robot"], seen["payload"], seen["policy"], seen["calm"]) == ("my_quad", 5.0, "patient", "calm")
    (warning,) = seen["warnings"]
    assert warning.startswith("extension broken (my_project.missing:EXTENSION) is left out: ModuleNotFoundError")


def test_installed_package_adds_policies_scenarios_and_measures_to_the_evaluator(site: Path, tmp_path: Path) -> None:
    command = ("-W", "ignore", "-m", "evaluate", "--policies", "patient", "trot", "--scenarios", "heavy_ice:1", "calm")
    done = run(site, *command, "--episodes", "2", "--out", "out", cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    rows = pq.read_table(tmp_path / "out" / "episodes.parquet").to_pylist()
    assert {row["scenario"] for row in rows} == {"heavy_ice:1", "calm"}
    assert all(row["largest_tilt"] > 0.0 for row in rows)
    same = {(row["scenario"], row["episode"]): row for row in rows if row["policy"] == "trot"}
    for row in rows:
        twin = same[row["scenario"], row["episode"]]
        assert (row["energy"], row["largest_tilt"]) == (twin["energy"], twin["largest_tilt"])
    assert "largest tilt" in (tmp_path / "out" / "report.html").read_text(encoding="utf-8")
    again = run(site, "-W", "ignore", "-m", "evaluate", "report", "out", cwd=tmp_path)
    assert again.returncode == 0, again.stderr
    number = next(index for index, row in enumerate(rows) if (row["policy"], row["scenario"]) == ("trot", "calm"))
    elsewhere = run(tmp_path, "-m", "evaluate", "replay", "out", str(number), cwd=tmp_path)  # without the package
    assert elsewhere.returncode == 0, elsewhere.stderr


def test_installed_package_is_named_by_the_commands_that_list(site: Path, tmp_path: Path) -> None:
    for command, name in (("scenarios", "heavy_ice"), ("policies", "patient")):
        done = run(site, "-W", "ignore", "-m", "quad_env", command, cwd=tmp_path)
        assert done.returncode == 0, done.stderr
        assert name in done.stdout


def test_an_extension_has_mappings_of_identifiers() -> None:
    with pytest.raises(TypeError, match="rewards: expected a mapping"):
        Extension(rewards=[max])  # type: ignore[arg-type]
    with pytest.raises(ValueError, match="'my reward' is not a Python identifier"):
        Extension(rewards={"my reward": max})
    with pytest.raises(TypeError, match=r"expected a quad_env\.Extension"):
        quad_env.add_extension({})  # type: ignore[arg-type]


def test_a_name_is_taken_once(added) -> None:
    added(Extension(policies={"mine": policies.Trot}))
    with pytest.raises(ValueError, match="policies mine exist already"):
        added(Extension(policies={"mine": policies.Trot}))


@pytest.mark.parametrize(
    ("extension", "use"),
    [
        (Extension(policies={"trot": policies.Trot}), policies.names),
        (Extension(robots={"go1": quad_env.SIMPLE_QUAD}), lambda: list(quad_env.ROBOTS)),
        (Extension(scenarios={"flat": quad_env.SCENARIOS["flat"]}), lambda: quad_env.scenario("no_such")),
        (Extension(axes={"push": quad_env.AXES["push"]}), lambda: quad_env.scenario("no_such:1")),
        (Extension(rewards={"tilt": abs}), lambda: gym.make("SimpleQuad-v0", rewards={"other": 1.0})),
    ],
)
def test_a_built_in_name_is_refused(added, extension: Extension, use) -> None:
    added(extension)
    with pytest.raises(ValueError, match="exist already; choose another name"):
        use()


def test_a_factory_that_raises_is_named(added) -> None:
    def factory(robot, control_period):
        raise RuntimeError("no licence")

    added(Extension(policies={"mine": factory, "none": lambda robot, control_period: None}))
    with pytest.raises(policies.PolicyError, match=r"policies mine: RuntimeError: no licence"):
        policies.make("mine")
    with pytest.raises(policies.PolicyError, match=r"policies none: expected a policies\.Policy, got NoneType"):
        policies.make("none")


def test_training_rewards_the_terms_of_an_extension(added) -> None:
    added(Extension(rewards={"mine": lambda state: state.height}))
    words = ["--extension-rewards", "mine", "3", "--ppo.envs", "2", "--mixture", "flat", "1", "--threads", "1"]
    config = parse([*words, "--ppo.rollout-steps", "2", "--ppo.minibatch", "4"])
    robots = make_robots(config)
    robots.reset(seed=[1, 2])
    *_, infos = robots.step(np.tile(robots.single_action_space.low, (2, 1)))
    heights = np.array([0.2, 0.7])
    assert (infos["reward_mine"] > 3.0 * 0.01 * heights[0]).all()
    assert (infos["reward_mine"] < 3.0 * 0.01 * heights[1]).all()
    for wrong, message in ((["yours", "1"], "unknown term 'yours'"), (["mine", "1e9"], "weights are from")):
        with pytest.raises(UsageError, match=message):
            parse(["--extension-rewards", *wrong])


HEIGHT = quad_env.ObservationTerm("trunk_height", 1, "m", 2.0, 1.0, lambda state: state.height)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"rewards": {"tilt": (abs, 1.0)}}, "tilt exists already; its weight is config.reward_weights.tilt"),
        ({"rewards": {"mine": 1.0}}, "unknown term 'mine'; valid: none is installed"),
        ({"rewards": {"mine": (abs, np.nan)}}, "weight is a finite number"),
        ({"rewards": {"mine": (3.0, 1.0)}}, r"expected \(function, weight\)"),
        ({"rewards": {"my reward": (abs, 1.0)}}, "not a Python identifier"),
        ({"observations": ("mine",)}, "unknown term 'mine'"),
        ({"observations": (HEIGHT, HEIGHT)}, "trunk_height exists already"),
        ({"observations": (3,)}, r"expected a quad_env\.ObservationTerm"),
    ],
)
def test_terms_are_checked_when_the_environment_is_made(options, message: str) -> None:
    with pytest.raises(ValueError, match=message):
        gym.make("SimpleQuad-v0", **options)


@pytest.mark.parametrize(("value", "message"), [(np.nan, "not finite"), (np.zeros(2), "expected a number, got")])
def test_a_reward_is_checked_at_every_step(value, message: str) -> None:
    env = gym.make("SimpleQuad-v0", rewards={"mine": (lambda state: value, 1.0)})
    env.reset(seed=0)
    with pytest.raises(ValueError, match=f"reward mine: .*{message}"):
        env.step(env.action_space.sample())


def test_terms_of_a_user_are_the_same_in_a_batch_and_change_no_other_number() -> None:
    options = {"rewards": {"mine": (lambda state: state.height, -2.0)}, "observations": (HEIGHT,)}
    bare = gym.make_vec("SimpleQuad-v0", num_envs=3)
    batch = gym.make_vec("SimpleQuad-v0", num_envs=3, **options)
    single = gym.make("SimpleQuad-v0", **options)
    targets = np.tile(quad_env.SIMPLE_QUAD.home_pose.astype(np.float32), (3, 1))
    bare.reset(seed=4), batch.reset(seed=4), single.reset(seed=4)
    for _ in range(20):
        plain, plain_reward, *_ = bare.step(targets)
        observations, rewards, _, _, infos = batch.step(targets)
        observation, reward, _, _, info = single.step(targets[0])
        np.testing.assert_array_equal(observations[:, :-1], plain)
        np.testing.assert_array_equal(rewards, plain_reward + infos["reward_mine"])
        np.testing.assert_array_equal(observations[0], observation)
        assert (rewards[0], infos["reward_mine"][0]) == (reward, info["reward_mine"])
        assert info["reward_mine"] == pytest.approx(-2.0 * 0.01 * float(observation[-1]), rel=1e-6)


def test_a_policy_receives_the_terms_that_it_asks_for() -> None:
    class Tall(policies.Stand):
        observations = (HEIGHT,)

    policy = Tall()
    env = gym.make("SimpleQuad-v0", observations=policy.observations)
    observation, _ = env.reset(seed=0)
    assert policy.act(observation).shape == (12,)
    with pytest.raises(ValueError, match="observation must have shape"):
        policy.act(observation[:-1])


def final_height(episodes: Episodes) -> FloatArray:
    """Return the trunk's height at the end of each episode, (n,), m."""
    return np.asarray(episodes.height[-1], np.float64)


def simulated_in_workers(monkeypatch: pytest.MonkeyPatch) -> list[EpisodeChunk]:
    """Return two chunks of one episode each of `stand` on level ground, from two worker processes."""
    monkeypatch.setattr(workers, "MIN_PARALLEL_STEPS", 0)
    flat = quad_env.SCENARIOS["flat"]
    policy = LabelledPolicy("stand", policies.make("stand"))
    tasks = [Task(policy, flat, np.array([i]), np.array([7 + i]), 110, IDEAL) for i in range(2)]
    return [chunk for _, chunk in workers.process_pool(2)(tasks, lambda *_: None)]


def test_worker_processes_receive_the_extensions_of_this_one(added, monkeypatch: pytest.MonkeyPatch) -> None:
    added(Extension(measures={"final_height": ExtraMeasure(final_height, "final height", "m")}))
    chunks = simulated_in_workers(monkeypatch)
    assert len(chunks) == 2
    for chunk in chunks:
        (height,) = chunk.cell.measures.extra["final_height"]
        assert 0.2 < height < 0.7


def test_an_extension_that_no_worker_can_receive_is_one_line(added, monkeypatch: pytest.MonkeyPatch) -> None:
    added(Extension(measures={"zero": ExtraMeasure(lambda episodes: np.zeros(episodes.count), "zero")}))
    with pytest.raises(UsageError, match=r"worker processes cannot receive it .* at the top of a module"):
        simulated_in_workers(monkeypatch)


def test_a_measure_of_another_shape_is_named(added) -> None:
    added(Extension(measures={"mine": ExtraMeasure(lambda episodes: np.zeros(3), "mine")}))
    flat = quad_env.SCENARIOS["flat"]
    policy = LabelledPolicy("stand", policies.make("stand"))
    with pytest.raises(ValueError, match=r"measures mine: expected the shape \(2,\), got \(3,\)"):
        simulate(Task(policy, flat, np.arange(2), np.arange(2), 110, IDEAL), 1, lambda _: None)
