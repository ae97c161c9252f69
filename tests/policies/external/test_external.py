"""External policies: every loader, the calls of a policy, and failures that affect only their own robots."""

import os
import pickle
import shutil
import subprocess
import sys
import time
from contextlib import closing
from dataclasses import replace
from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np
import pytest
from gymnasium.wrappers.vector import RecordEpisodeStatistics
from stable_baselines3 import PPO, SAC
from stable_baselines3.common.vec_env import DummyVecEnv, VecNormalize

import policies
from live.commands.doctor import check_exists
from policies.base import CONTROL_PERIOD, PolicyError
from policies.external import ExternalPolicy, is_reference, sb3_file
from policies.external.reference import PolicyReference, resolve_reference
from policies.external.server import PolicyServer, make_server
from quad_env import OBSERVATION, OBSERVATION_SIZE, SIMPLE_QUAD, HomePoseActions, VectorHomePoseActions
from quad_env.cli.command_line import UsageError
from tests.seams import deadlines, without_processor_wait
from train.sb3.vec_env import TrainingVecEnv

FILE = """
import os, sys, time
import numpy as np
import policies

def one(observation):
    assert observation.shape == (48,)
    return [0.1] * 12

def of_any(observation):
    return observation[..., 12:24]

def short(observation):
    return np.zeros(3)

class Counts:
    def __init__(self):
        self.calls = 0

    def __call__(self, observation):
        assert observation.ndim == 1
        self.calls += 1
        return np.full(12, 0.01 * self.calls)

counts = Counts()

class Timed(Counts):
    def __init__(self, *, control_period, robot):
        super().__init__()
        self.told = control_period, robot.name

class Walk(policies.Trot):
    name = "walk of mine"

walk = policies.Trot()

class Faulty(Counts):
    def __call__(self, observation):
        action = super().__call__(observation)
        return self.fault() if observation[-3] > 0.0 and self.calls == 3 else action

class Slow(Counts):
    def __call__(self, observation):
        time.sleep(0.02)
        return super().__call__(observation)

class Sleeps(Counts):
    def __call__(self, observation):
        time.sleep(0.5)
        return super().__call__(observation)

class LoadsSlowly(Counts):
    def __init__(self):
        super().__init__()
        time.sleep(0.5)

class NeedsMore:
    def __init__(self, weights):
        pass

number = 3
"""
FAULTS = {
    "Raises": ("raise KeyError('two\\nlines')", "raised KeyError: 'two\\nlines'"),
    "Exits": ("sys.exit(4)", "raised SystemExit: 4"),
    "Paints": ("raise ValueError('\x1b[31m red\x07')", "raised ValueError: [31m red"),
    "Short": ("return np.zeros(3)", "gave float64 of shape (3,), not numbers of shape (12,)"),
    "Nan": ("return np.full(12, np.nan)", "gave targets that are not finite"),
}
"""Class -> its action in the third call of a robot with a forward command, and the reported reason of the failure."""
WITHOUT_ANSWER = {"Hangs": ("time.sleep(60.0)",), "Ends": ("os._exit(3)",)}
for name, (fault, *_) in (FAULTS | WITHOUT_ANSWER).items():
    FILE += f"\nclass {name}(Faulty):\n    def fault(self):\n        {fault}\n"
OBSERVATIONS = np.zeros((3, OBSERVATION_SIZE), np.float32)
OBSERVATIONS[1, OBSERVATION["command"].start] = 1.0
OTHERS = [0, 2]


def small() -> dict[str, Any]:
    """Return the arguments of a small learner of Stable-Baselines3; the learner modifies the dictionary."""
    return {"seed": 0, "device": "cpu", "policy_kwargs": {"net_arch": [8]}}


@pytest.fixture(autouse=True)
def _same_path(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sys, "path", list(sys.path))


@pytest.fixture
def file(tmp_path: Path) -> Path:
    path = tmp_path / "my_file.py"
    path.write_text(FILE, encoding="utf-8")
    return path


def served(file: Path, name: str = "", deadline: float = 5.0) -> PolicyServer:
    return make_server(PolicyReference(file, name), SIMPLE_QUAD, CONTROL_PERIOD, deadline)


def third_step(of: PolicyServer) -> tuple[np.ndarray, dict[int, str]]:
    """Return actions and failures of the third control step of three robots; the second has a forward command."""
    assert of.reset(3, 0) == {}
    for _ in range(2):
        assert of.step(OBSERVATIONS).failures == {}
    answer = of.step(OBSERVATIONS)
    return answer.actions, answer.failures


def test_a_function_is_asked_for_each_robot(file: Path) -> None:
    for name, expected in (("one", np.full((3, 12), np.float32(0.1))), ("of_any", OBSERVATIONS[:, 12:24])):
        of = served(file, name)
        of.reset(3, 0)
        np.testing.assert_array_equal(of.step(OBSERVATIONS).actions, expected)


@pytest.mark.parametrize("name", ["Counts", "counts", "Timed"])
def test_every_robot_has_an_object_of_its_own_anew_at_each_reset(file: Path, name: str) -> None:
    of = served(file, name)
    for _ in range(2):
        np.testing.assert_allclose(third_step(of)[0], 0.03)
    of.reset_where(np.array([False, True, False]))
    np.testing.assert_allclose(of.step(OBSERVATIONS).actions[:, 0], [0.04, 0.01, 0.04])


def test_a_policy_of_ours_in_a_file_acts_as_it_does_here(file: Path) -> None:
    of, trot = served(file, "Walk"), policies.make("trot")
    trot.reset(3)
    of.reset(3, 0)
    for _ in range(5):
        expected, answer = trot.act(OBSERVATIONS), of.step(OBSERVATIONS)
        np.testing.assert_array_equal(answer.actions, expected)
        np.testing.assert_array_equal(answer.signals["phase"], trot.phase)


@pytest.mark.parametrize("name", FAULTS)
def test_a_failure_is_that_of_one_robot(file: Path, name: str) -> None:
    of = served(file, name)
    actions, failures = third_step(of)
    assert failures == {1: FAULTS[name][1]}
    np.testing.assert_allclose(actions[OTHERS], 0.03)
    again = of.step(OBSERVATIONS)
    assert again.failures == {}
    np.testing.assert_allclose(again.actions[OTHERS], 0.04)


PASSING = (
    """
import numpy as np
import policies

class Passing:
    """
    + '"""Fails in its third call where it is commanded forward, and never again."""'
    + """
    def __init__(self):
        self.calls = 0

    def __call__(self, observation):
        self.calls += 1
        if observation[-3] > 0.0 and self.calls == 3:
            raise ValueError("for once")
        return np.full(12, 0.01 * self.calls)

class Whole(policies.Trot):
    """
    + '"""The same of all robots at once."""'
    + """
    fails = 3

    def _act(self, observation):
        self.fails -= 1
        if self.fails == 0:
            raise ValueError("for once")
        return super()._act(observation)
"""
)


def test_a_robot_that_its_policy_failed_is_moved_again_in_its_next_episode(tmp_path: Path) -> None:
    """The failed robot moves in its next episode, fails again there, and reports it again."""
    path = tmp_path / "passing.py"
    path.write_text(PASSING, encoding="utf-8")
    of = served(path, "Passing")
    told = {1: "raised ValueError: for once"}
    assert third_step(of)[1] == told
    assert of.step(OBSERVATIONS).failures == {}  # a failure is reported once
    assert of.reset_where(np.array([True, False, False])) == {}
    assert not of.step(OBSERVATIONS).actions[1].any()
    assert of.reset_where(np.array([False, True, False])) == {}
    np.testing.assert_allclose(of.step(OBSERVATIONS).actions[:, 0], [0.02, 0.01, 0.06])
    assert of.step(OBSERVATIONS).failures == {}
    assert of.step(OBSERVATIONS).failures == told
    assert of.reset(3, 0) == {}
    np.testing.assert_allclose(of.step(OBSERVATIONS).actions[:, 0], 0.01)


def test_a_policy_of_all_robots_that_failed_moves_those_that_begin_again(tmp_path: Path) -> None:
    path = tmp_path / "passing.py"
    path.write_text(PASSING, encoding="utf-8")
    of = served(path, "Whole")
    of.reset(3, 0)
    assert of.step(OBSERVATIONS).failures == {}
    assert of.step(OBSERVATIONS).failures == dict.fromkeys(range(3), "raised ValueError: for once")
    assert not of.step(OBSERVATIONS).actions.any()
    assert of.reset_where(np.array([False, True, False])) == {}
    answer = of.step(OBSERVATIONS)
    assert answer.failures == {}
    assert answer.actions[1].any()


def test_a_process_that_gives_no_answer_is_ended_within_a_deadline_whatever_the_number_of_robots(
    file: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    deadlines(monkeypatch, act=1.0, grace=0.5)
    robots = 256
    observations = np.resize(OBSERVATIONS, (robots, OBSERVATION_SIZE))
    with closing(ExternalPolicy(f"{file}:Hangs", robot="simple_quad")) as policy:
        policy.reset(robots)
        for _ in range(2):
            policy.act(observations)
        began = time.monotonic()
        policy.act(observations)
        assert policy.failure.tolist() == ["gave no answer within 1 s"] * robots
        assert time.monotonic() - began < 20.0  # the bound holds on a busy machine


def test_many_robots_that_are_each_answered_for_in_time_may_take_longer_together(
    file: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    deadlines(monkeypatch, act=1.0, grace=0.2)
    robots = 100
    with closing(ExternalPolicy(f"{file}:Slow")) as policy:
        policy.reset(robots)
        for step in (1, 2):
            action = policy.act(np.zeros((robots, OBSERVATION_SIZE), np.float32))
            np.testing.assert_allclose(action[:, 0], 0.01 * step, rtol=1e-6)
        assert policy.failure.tolist() == [None] * robots


@pytest.mark.parametrize(
    ("name", "words"),
    [
        ("short", ["an action (12,) for an observation (48,)", "shape (3,)"]),
        ("number", ["number", "callable", "3"]),
        ("nothing", ["no 'nothing'", "one, of_any", "Walk"]),
        ("NeedsMore", ["NeedsMore", "cannot be made", "weights"]),
    ],
)
def test_what_is_no_policy_is_refused_in_words(file: Path, name: str, words: list[str]) -> None:
    with pytest.raises(PolicyError) as refused:
        served(file, name)
    assert all(word in str(refused.value) for word in words), refused.value


def test_a_file_that_fails_is_refused_in_words(tmp_path: Path) -> None:
    (tmp_path / "broken.py").write_text("import sys; sys.exit(2)", encoding="utf-8")
    with pytest.raises(PolicyError, match=r"broken\.py fails: SystemExit: 2"):
        served(tmp_path / "broken.py", "x")


def test_a_policy_made_for_another_control_period_is_refused(tmp_path: Path) -> None:
    (tmp_path / "slow.py").write_text("import policies\nslow = policies.Trot(control_period=0.02)\n", encoding="utf-8")
    with pytest.raises(PolicyError, match=r"0\.02 s, not for simple_quad with one of 0\.01 s"):
        served(tmp_path / "slow.py", "slow")


def test_references(tmp_path: Path) -> None:
    (tmp_path / "folder.onnx").mkdir()
    named = ["a.py:B", "a.py", "a.onnx", "a.zip", "/x/y.py:Z"]
    assert [
        text for text in [*named, "trot", "models/residual", str(tmp_path / "folder.onnx")] if is_reference(text)
    ] == named


def test_what_runs_hidden_code_wants_trust_and_what_is_missing_is_named(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    for name in ("model.zip", "net.onnx", "own.py"):
        (tmp_path / name).touch()
    with pytest.raises(PolicyError, match="--trust"):
        resolve_reference(tmp_path / "model.zip", trust=False)
    with pytest.raises(PolicyError, match=r"own\.py:MyPolicy"):
        resolve_reference(tmp_path / "own.py", trust=True)
    with pytest.raises(PolicyError, match="there is no file"):
        resolve_reference("gone.onnx", trust=True)
    monkeypatch.setitem(sys.modules, "torch", None)
    monkeypatch.setitem(sys.modules, "onnx", None)
    with pytest.raises(PolicyError, match=r"needs torch, .*\.\[train\]"):
        sb3_file.load_sb3(resolve_reference(tmp_path / "model.zip", trust=True), SIMPLE_QUAD)
    with pytest.raises(PolicyError, match=r"needs onnx, .*\.\[onnx\]"):
        resolve_reference(tmp_path / "net.onnx", trust=True)


def test_in_its_process_a_policy_that_ends_it_loses_its_robots_until_a_reset(file: Path) -> None:
    policy = pickle.loads(pickle.dumps(ExternalPolicy(f"{file}:Ends")))
    assert policy.failure.tolist() == [None]
    home = np.tile(SIMPLE_QUAD.home_pose.astype(np.float32), (3, 1))
    try:
        for _ in range(2):
            policy.reset(3)
            np.testing.assert_allclose(policy.act(OBSERVATIONS)[:, 0], 0.01, rtol=1e-6)
            policy.act(OBSERVATIONS)
            np.testing.assert_array_equal(policy.act(OBSERVATIONS), home)
            assert policy.failure.tolist() == ["gave no answer: the policy's process has ended"] * 3
            np.testing.assert_array_equal(policy.act(OBSERVATIONS), home)
    finally:
        policy.close()


def test_a_model_of_stable_baselines3_acts_as_it_does_there(tmp_path: Path) -> None:
    env = gym.make("quad_env:SimpleQuad-v0")
    observation, _ = env.reset(seed=0)
    for model in (PPO("MlpPolicy", env, **small()), SAC("MlpPolicy", env, buffer_size=10, **small())):
        model.save(tmp_path / "model.zip")
        of = served(tmp_path / "model.zip")
        of.reset(2, 0)
        answer = of.step(np.stack([observation, observation]))
        assert answer.failures == {}
        np.testing.assert_array_equal(answer.actions[1], model.predict(observation, deterministic=True)[0])
    (tmp_path / "model.zip").write_bytes(b"nothing")
    with pytest.raises(PolicyError, match="not a model of Stable-Baselines3"):
        served(tmp_path / "model.zip")


@pytest.fixture(scope="module")
def normalised(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Any]:
    """Return a model that was trained on normalised observations, `model.zip`, and its joint targets."""
    folder = tmp_path_factory.mktemp("normalised")
    env = VecNormalize(DummyVecEnv([lambda: HomePoseActions(gym.make("quad_env:SimpleQuad-v0"), 0.3)]))
    model = PPO("MlpPolicy", env, n_steps=64, batch_size=64, **small()).learn(128)
    model.save(folder / "model.zip")
    env.save(str(folder / "vecnormalize.pkl"))

    def targets(observations: np.ndarray) -> np.ndarray:
        offsets = model.predict(env.normalize_obs(observations), deterministic=True)[0]
        raw = model.predict(observations, deterministic=True)[0]
        assert np.abs(offsets - raw).max() > 1e-3
        return SIMPLE_QUAD.home_pose + 0.3 * np.clip(offsets, -1.0, 1.0)

    return folder, targets


@pytest.mark.parametrize(
    ("model", "statistics"),
    [
        ("model.zip", "vec_normalize.pkl"),
        ("model.zip", "model/vecnormalize.pkl"),
        ("walk_v2_128_steps.zip", "walk_v2_vecnormalize_128_steps.pkl"),
        ("best_model/best_model.zip", "vecnormalize.pkl"),
        ("best_model/best_model.zip", "vec_normalize.pkl"),
        ("best_model/best_model.zip", "walk_vecnormalize.pkl"),
        ("Walk-v0_1/best_model.zip", "Walk-v0_1/Walk-v0/vecnormalize.pkl"),
        ("Walk-v0_1/rl_model_128_steps.zip", "Walk-v0_1/Walk-v0/vecnormalize.pkl"),
    ],
)
def test_a_model_of_normalised_observations_is_given_such(
    model: str, statistics: str, normalised: tuple[Path, Any], tmp_path: Path
) -> None:
    folder, targets = normalised
    (tmp_path / model).parent.mkdir(parents=True, exist_ok=True)
    (tmp_path / statistics).parent.mkdir(parents=True, exist_ok=True)
    shutil.copy(folder / "model.zip", tmp_path / model)
    shutil.copy(folder / "vecnormalize.pkl", tmp_path / statistics)
    of = make_server(resolve_reference(tmp_path / model, trust=True), SIMPLE_QUAD, CONTROL_PERIOD, 5.0)
    of.reset(3, 0)
    np.testing.assert_allclose(of.step(OBSERVATIONS).actions, targets(OBSERVATIONS), atol=1e-6)


def test_several_statistics_of_a_run_are_asked_about(normalised: tuple[Path, Any], tmp_path: Path) -> None:
    folder, _ = normalised
    model = tmp_path / "best_model/best_model.zip"
    model.parent.mkdir()
    shutil.copy(folder / "model.zip", model)
    assert resolve_reference(model, trust=True).remarks == ()
    for steps in (128, 256):
        shutil.copy(folder / "vecnormalize.pkl", tmp_path / f"walk_vecnormalize_{steps}_steps.pkl")
    with pytest.raises(PolicyError, match=r"walk_vecnormalize_128_steps\.pkl, .*_256_steps\.pkl; rename the one"):
        resolve_reference(model, trust=True)
    (tmp_path / "walk_vecnormalize_128_steps.pkl").unlink()
    found = resolve_reference(model, trust=True)
    assert found.remarks == (f"its observations are normalised by {found.normaliser}, the only statistics of its run",)
    with pytest.raises(PolicyError, match=r"best_model\.zip and .*_256_steps\.pkl can run code .* in them: .*--trust"):
        resolve_reference(model, trust=False)


@pytest.mark.parametrize(
    ("model", "statistics"),
    [
        ("best_model/best_model.zip", "checkpoints/walk_vecnormalize_128_steps.pkl"),
        ("model.zip", "vec_norm.pkl"),
        ("model.zip", "vec_normalize"),
        ("model.zip", "obs_normaliser.pickle"),
    ],
)
def test_statistics_elsewhere_or_of_other_names_are_asked_about(model: str, statistics: str, tmp_path: Path) -> None:
    for file in (model, statistics):
        (tmp_path / file).parent.mkdir(exist_ok=True)
        (tmp_path / file).touch()
    with pytest.raises(PolicyError, match=rf"may be trained on normalised observations: .*{Path(statistics).name}; re"):
        resolve_reference(tmp_path / model, trust=True)


def test_statistics_that_may_belong_to_a_model_are_never_left_out_silently(
    normalised: tuple[Path, Any], tmp_path: Path
) -> None:
    folder, _ = normalised
    shutil.copy(folder / "model.zip", tmp_path)
    before = resolve_reference(tmp_path / "model.zip", trust=True).sha256
    shutil.copy(folder / "vecnormalize.pkl", tmp_path / "final_VecNormalize.pkl")
    with pytest.raises(PolicyError, match=r"final_VecNormalize\.pkl; rename .* to model_vecnormalize\.pkl"):
        resolve_reference(tmp_path / "model.zip", trust=True)
    with pytest.raises(PolicyError, match="--trust"):
        resolve_reference(tmp_path / "model.zip", trust=False)
    (tmp_path / "final_VecNormalize.pkl").rename(tmp_path / "vecnormalize.pkl")
    assert resolve_reference(tmp_path / "model.zip", trust=True).sha256 != before
    (tmp_path / "vecnormalize.pkl").write_bytes(b"nothing")
    with pytest.raises(PolicyError, match=r"vecnormalize\.pkl is not a VecNormalize of model\.zip"):
        make_server(resolve_reference(tmp_path / "model.zip", trust=True), SIMPLE_QUAD, CONTROL_PERIOD, 5.0)


@pytest.mark.parametrize("name", ["walk.pth", "safe:walk.pth"])
def test_files_that_are_not_read_are_told_from_unknown_names(name: str) -> None:
    with pytest.raises(PolicyError, match=r"not supported; export the network as \.onnx .*my_file\.py:MyPolicy"):
        policies.resolve(name)
    with pytest.raises(UsageError, match="not supported"):
        check_exists(name)


@pytest.mark.parametrize("batch", [False, True], ids=["one robot", "native batch"])
def test_a_model_that_was_trained_about_the_home_pose_gives_joint_targets(tmp_path: Path, batch: bool) -> None:
    if batch:
        robots = gym.make_vec("quad_env:SimpleQuad-v0", num_envs=2, autoreset_mode="SAME_STEP")
        env = TrainingVecEnv(RecordEpisodeStatistics(VectorHomePoseActions(robots, 0.3)), seeds=[0, 1])
    else:
        env = HomePoseActions(gym.make("quad_env:SimpleQuad-v0"), 0.3)
    model = PPO("MlpPolicy", env, **small())
    model.save(tmp_path / "model.zip")
    of = served(tmp_path / "model.zip")
    of.reset(3, 0)
    answer = of.step(OBSERVATIONS)
    offsets = model.predict(OBSERVATIONS, deterministic=True)[0]
    assert np.abs(offsets).max() > 0.0
    np.testing.assert_allclose(answer.actions, SIMPLE_QUAD.home_pose + 0.3 * offsets, atol=1e-6)
    with pytest.raises(PolicyError, match="home pose of simple_quad, not of another"):
        make_server(PolicyReference(tmp_path / "model.zip"), replace(SIMPLE_QUAD, name="another"), CONTROL_PERIOD, 5.0)


def test_a_model_of_rescaled_actions_is_refused_since_nothing_tells_what_they_stand_for(tmp_path: Path) -> None:
    one = np.ones(12, np.float32)
    env = gym.wrappers.RescaleAction(gym.make("quad_env:SimpleQuad-v0"), -one, one)
    PPO("MlpPolicy", env, **small()).save(tmp_path / "model.zip")
    with pytest.raises(PolicyError, match=r"from -1 to 1.*quad_env\.HomePoseActions"):
        served(tmp_path / "model.zip")


def test_a_script_without_a_guard_has_its_policy(file: Path, tmp_path: Path) -> None:
    """The policy's process does not run the main script again, which would start processes without end."""
    script = tmp_path / "script.py"
    script.write_text(
        "import numpy as np, policies\n"
        f"policy = policies.resolve({str(file) + ':Counts'!r})\n"
        "policy.reset(1)\n"
        "print('done', policy.act(np.zeros((1, 48), np.float32)).shape)\n"
        "policy.close()\n"
    )
    environment = os.environ | {"PYTHONPATH": os.pathsep.join(filter(None, sys.path))}
    run = subprocess.run(
        [sys.executable, script], capture_output=True, text=True, timeout=120, env=environment, check=False
    )
    assert (run.stdout, run.stderr) == ("done (1, 12)\n", "")


@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="only Linux says how long a process waited")
def test_a_policy_that_gets_little_of_the_processor_is_not_taken_for_one_that_hangs(
    file: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The deadline excludes the time that the process waits for a processor; here the whole time counts as waiting."""
    deadlines(monkeypatch, act=0.02, grace=0.0)
    with closing(ExternalPolicy(f"{file}:Sleeps", robot="simple_quad")) as policy:
        policy.reset(1)
        policy.act(OBSERVATIONS[:1])
        assert policy.failure[0] is not None
    without_processor_wait(monkeypatch)
    with closing(ExternalPolicy(f"{file}:Sleeps", robot="simple_quad")) as policy:
        policy.reset(1)
        policy.act(OBSERVATIONS[:1])
        assert policy.failure.tolist() == [None]


def test_limits_of_time_can_be_raised(file: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    deadlines(monkeypatch, grace=0.0)
    monkeypatch.setenv("QUAD_ENV_LOAD_TIMEOUT", "0.05")
    with pytest.raises(PolicyError, match="no answer within 50 ms"):
        ExternalPolicy(f"{file}:LoadsSlowly", robot="simple_quad")
    monkeypatch.setenv("QUAD_ENV_LOAD_TIMEOUT", "100")
    monkeypatch.setenv("QUAD_ENV_ACT_TIMEOUT", "0.01")
    with closing(ExternalPolicy(f"{file}:LoadsSlowly", robot="simple_quad")) as policy:
        policy.reset(1)
        policy.act(OBSERVATIONS[:1])
        assert policy.failure.tolist() == ["gave no answer within 0.06 s"]
