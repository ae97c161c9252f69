"""Every option of `python -m train` has its effect, in one run with all options different from their defaults.

`EFFECTS` has an entry for each option; an option without an entry fails.
"""

import contextlib
import dataclasses
import json
import threading
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import policies
from policies.history import Inputs
from quad_env.cli.interrupt import Interrupt
from quad_env.config import PhysicsOptions, RewardWeights
from quad_env.scenarios.disturbances import Kicks
from quad_env.seeding import episode_seeds
from tests.batches import Batch, begun
from tests.quad_env.robots.alike import alike
from train import run as training_run
from train import validation
from train.__main__ import main
from train.commands.run import parse
from train.config import REWARDS, TrainConfig
from train.curriculum import TERRAIN_SEEDS
from train.run import make_env
from train.run_folder import VALIDATIONS_FILE, steps_done
from train.sb3.callbacks import CallbackState, TrainingCallback
from train.sb3.ppo import make_ppo
from train.training_robots import training_seeds

WORDS = (
    "--base mpc --steps 48 --seed 7 --threads 3 --joint-authority 0.2 --hip-authority 0.1 "
    "--inputs.lags 0.03 --inputs.averages 0.2 --inputs.clock 4 --inputs.clock-at-rest hidden --correction scaled "
    "--clock-phase random --commands random --kicks 2 --physics.contacts feet-trunk --reward-floor -0.3 "
    "--timestep 0.0025 --solver-iterations 7 "
    "--mixture push=60 1 rough=0.2 3 --curriculum 0.5 "
    "--effort-ramp 1 --max-episode-steps 20 --servo 30/0.6 --actuator motor --sensors typical --estimator kalman "
    "--ppo.envs 4 --ppo.rollout-steps 3 --ppo.minibatch 6 --ppo.epochs 1 "
    "--ppo.hold 3 --ppo.actor 4 --ppo.critic 4 --ppo.learning-rate-schedule adaptive --ppo.target-kl 0.04 "
    "--ppo.log-std-final -3.2 --ppo.critic-steps 37 --ppo.cloning 0.5 --ppo.cloning-steps 80 --ppo.cloning-final 0.1 "
    "--validation.interval 24 --validation.episodes 3 --validation.scenarios push rough=0.1 "
    "--out FOLDER/elsewhere"
)
BRIEF = 110
"""Number of control steps of a validation episode, just longer than the second that the measures leave out."""
SMALL = "--threads 1 --ppo.envs 4 --ppo.rollout-steps 2 --ppo.minibatch 4 --ppo.hold 1 --ppo.actor 4 --ppo.critic 4"


@dataclass(frozen=True)
class Ran:
    """A completed run."""

    folder: Path
    batches: list[Batch]
    learner: Any
    threads: set[str]
    """Names of the threads that stepped batches in parallel."""

    @property
    def env(self) -> Any:
        """Return the environment with base and correction."""
        return self.learner.get_env().env

    @property
    def policy(self) -> Any:
        """Return the policy of the run's last bundle."""
        return policies.load(self.folder / "last")

    def of(self, purpose: str) -> list[Batch]:
        """Return the batches with a purpose."""
        return [each for each in self.batches if each.purpose == purpose]


@pytest.fixture(scope="module")
def ran(tmp_path_factory: pytest.TempPathFactory) -> Ran:
    folder, learners, threads = tmp_path_factory.mktemp("every"), [], set[str]()
    true_build, true_run = training_run.make_ppo, validation.run

    def watched(*args: Any) -> Any:
        learners.append(true_build(*args))
        return learners[-1]

    def brief(*args: Any, **kwargs: Any) -> Any:
        threads.update(each.name for each in threading.enumerate() if each.name.startswith("robots"))
        return true_run(*args, **kwargs | {"steps": BRIEF})

    with begun() as batches, pytest.MonkeyPatch.context() as patch:
        patch.setattr(training_run, "make_ppo", watched)
        patch.setattr(validation, "run", brief)
        assert main(WORDS.replace("FOLDER", str(folder)).split()) == 0
    batches = [each for each in batches if each.purpose in ("training", "validation")]
    return Ran(folder / "elsewhere", batches, learners[-1], threads)


def remembered(ran: Ran) -> dict[str, Any]:
    """Return the state of the callbacks in the last checkpoint."""
    return dict(json.loads(max(ran.folder.glob("checkpoints/*.json")).read_bytes())["remembered"])


def validations(ran: Ran) -> list[dict[str, Any]]:
    return list(json.loads((ran.folder / VALIDATIONS_FILE).read_bytes())["validations"])


def hardware(ran: Ran) -> set[tuple[bool, bool, str]]:
    """Return for training and validation: heating of motors, sensor readings, type of the estimator."""
    return {(each.warms, each.sensed, type(each.env.estimator).__name__) for each in ran.batches}


def of_both(read: Callable[[Any], Any]) -> Callable[[Ran], Any]:
    """Return a reading of the learner's environment and of the resulting policy."""
    return lambda ran: [read(ran.env), read(ran.policy)]


def commands(batch: Batch) -> tuple[bool, tuple[float, ...], float]:
    """Return how commands are drawn: random times, probability of each component, probability to keep one."""
    drawn = batch.env.scenario.commands
    return drawn.random_intervals, drawn.on_probability, drawn.keep_probability


def authority(each: Any) -> list[float]:
    """Return the authority of hip, thigh and calf, rad."""
    return [round(float(value), 6) for value in each.authority[:3]]


SEEDS = episode_seeds("training", 0, 4).tolist()
EFFECTS: dict[str, tuple[Callable[[Ran], Any], Any]] = {
    "policy": (lambda ran: ran.policy.name, "residual"),  # the other value has a test in test_command.py
    "base": (lambda ran: [ran.env.bases[0].base.name, ran.policy.base.name], ["mpc"] * 2),
    "steps": (lambda ran: steps_done(ran.folder), 48),
    "seed": (
        lambda ran: (ran.learner.seed, ran.of("training")[1].env.scenario.terrain.seed),  # type: ignore[union-attr]
        (7, TERRAIN_SEEDS["training"] + 7),
    ),
    "out": (lambda ran: ran.folder.is_dir(), True),
    "threads": (
        lambda ran: ({(each.purpose, each.threads) for each in ran.batches}, ran.threads),
        ({("training", 3), ("validation", 3)}, set()),  # a user's reward term is called by one thread
    ),
    "joint_authority": (of_both(lambda each: authority(each)[1:]), [[0.2, 0.2]] * 2),
    "hip_authority": (of_both(lambda each: authority(each)[0]), [0.1] * 2),
    "inputs": (
        lambda ran: [ran.env.bases[0]._feature_extractor.inputs, ran.policy.features.inputs],
        [Inputs(lags=(0.03,), averages=(0.2,), clock=4.0, clock_at_rest="hidden")] * 2,
    ),
    "correction": (lambda ran: [ran.env._bounded, ran.policy.bounded], [False, False]),
    "clock_phase": (lambda ran: ran.env._random_clock_phase, True),
    "commands": (
        lambda ran: [(*commands(each), each.purpose) for each in (ran.of("training")[0], ran.of("validation")[0])],
        [(True, (0.9, 0.25, 0.5), 0.5, "training"), (False, (1.0, 1.0, 1.0), 0.0, "validation")],
    ),
    "kicks": (
        lambda ran: [each.env.scenario.kicks for each in (ran.of("training")[0], ran.of("validation")[0])],
        [Kicks(speed=2.0), None],
    ),
    "physics": (
        lambda ran: [each.env.config.physics for each in (ran.of("training")[0], ran.of("validation")[0])],
        [PhysicsOptions(contacts="feet-trunk"), PhysicsOptions()],
    ),
    "timestep": (
        lambda ran: [
            each.env.simulation.model.opt.timestep for each in (ran.of("training")[0], ran.of("validation")[0])
        ],
        [0.0025, 0.002],
    ),
    "solver_iterations": (
        lambda ran: [
            each.env.simulation.model.opt.iterations for each in (ran.of("training")[0], ran.of("validation")[0])
        ],
        [7, 30],
    ),
    "reward_floor": (lambda ran: ran.learner.get_env()._reward_floor, -0.3),
    "mixture": (
        lambda ran: {each.env.scenario.name: len(each.seeds) for each in ran.of("training")},
        {"push=60": 1, "rough=0.2": 3},
    ),
    "curriculum": (
        # Half of the way from 20 N·s and from 0.06 m, in log severity.
        lambda ran: [*(each.env.scenario.severity for each in ran.of("training")[:2]), *remembered(ran)["shares"]],
        pytest.approx([(20 * 60) ** 0.5, (0.06 * 0.2) ** 0.5, 0.5, 0.5]),
    ),
    "effort_ramp": (  # the second of two segments begins at half of the run
        lambda ran: [torque_factor(ran.of("training")[which].env) / REWARDS.torque for which in (0, -1)],
        pytest.approx([0.0, 0.005]),
    ),
    "max_episode_steps": (  # the seeds of the robots determine the length of the first episodes
        lambda ran: ran.env.unwrapped._first_episode_steps(SEEDS).tolist(),
        np.random.default_rng(SEEDS).integers(1, 20, 4, endpoint=True).tolist(),
    ),
    "servo": (lambda ran: {float(each.env.robot.servo_stiffness[0]) for each in ran.batches}, {30.0}),
    "actuator": (lambda ran: {warms for warms, _, _ in hardware(ran)}, {True}),
    "sensors": (lambda ran: {sensed for _, sensed, _ in hardware(ran)}, {True}),
    "estimator": (lambda ran: {estimator for _, _, estimator in hardware(ran)}, {"KalmanFilter"}),
    "ppo.hold": (lambda ran: [ran.env._hold, ran.policy.hold], [3, 3]),
    "ppo.learning_rate_schedule": (lambda ran: type(ran.learner.learning_rate).__name__, "AdaptiveRate"),
    "ppo.target_kl": (lambda ran: ran.learner.learning_rate.target_kl, 0.04),
    "ppo.log_std_final": (  # three quarters of the way from -2, since the last of four rollouts begins at 3/4
        lambda ran: [ran.learner.policy.log_std[0].item(), ran.learner.policy.log_std.requires_grad],
        [pytest.approx(-2.0 - 0.75 * 1.2), False],
    ),
    # The last of four rollouts of twelve samples begins at 36 steps.
    "ppo.critic_steps": (
        lambda ran: [each.requires_grad for each in ran.learner.policy.action_net.parameters()],
        [False, False],
    ),
    "ppo.cloning": (lambda ran: ran.learner.policy.cloning_weight, pytest.approx(0.5 - 0.4 * 36 / 80)),
    "ppo.cloning_steps": (lambda ran: ran.learner.policy.cloning_weight, pytest.approx(0.5 - 0.4 * 36 / 80)),
    "ppo.cloning_final": (lambda ran: ran.learner.policy.cloning_weight, pytest.approx(0.5 - 0.4 * 36 / 80)),
    "validation.interval": (lambda ran: [each["steps"] for each in validations(ran)], [24, 48]),
    "validation.episodes": (lambda ran: {len(each.seeds) for each in ran.of("validation")}, {3}),
    "validation.scenarios": (
        lambda ran: [each.env.scenario.name for each in ran.of("validation")],
        ["push", "rough=0.1"] * 2,
    ),
}
ELSEWHERE = (
    {"recipe", "resume", "start", "rewards", "extension_rewards", "robot", "device", "sighted", "scan"}
    | {"observations"}
    | {
        *("ppo.envs", "ppo.rollout_steps", "ppo.minibatch", "ppo.epochs", "ppo.learning_rate", "ppo.gamma"),
        *("ppo.gae_lambda", "ppo.entropy", "ppo.log_std_init", "ppo.actor", "ppo.critic"),
        *(
            "ppo.learning_rate_final",
            "ppo.symmetry",
            "ppo.normalization",
            "ppo.critic_learning_rate",
            "seeds",
            "part",
            "ray",
        ),
    }
)
"""Options with their own tests, below or in another module of this folder.

The options of the learner are tested in tests/planted_faults/test_training_faults.py and sb3/test_ppo.py.
"""


def torque_factor(env):
    """Return the factor on the reward term of the torque in one control step of an environment."""
    factors = {key: factor for key, factor, _ in env._reward_weights.computed}
    return factors.get("reward_torque", 0.0)


def options(config: Any, prefix: str = "") -> Iterator[str]:
    """Return the names of all options, with the prefix of their group."""
    for field in dataclasses.fields(config):
        value = getattr(config, field.name)
        if dataclasses.is_dataclass(value) and field.name not in ("rewards", "inputs", "scan", "physics"):
            yield from options(value, f"{prefix}{field.name}.")
        else:
            yield prefix + field.name


def test_every_option_has_an_effect_that_is_tested() -> None:
    assert set(options(TrainConfig())) == EFFECTS.keys() | ELSEWHERE


@pytest.mark.parametrize("option", EFFECTS)
def test_an_option_reaches_what_it_governs(option: str, ran: Ran) -> None:
    read, expected = EFFECTS[option]
    assert read(ran) == expected


NEEDY = {"gait", "stand_still"}
"""Terms that need a clock, or a command to stand; test_rewards.py and test_residual_env.py have them."""


def test_the_weight_of_a_reward_term_is_what_robots_earn_by() -> None:
    """The falls are the same: first all terms have weight 1, then each term has √2 times the weight of the previous."""
    terms = tuple(field.name for field in dataclasses.fields(RewardWeights) if field.name not in NEEDY)
    found = []
    for weights in (np.ones(len(terms)), 2.0 ** (0.5 * np.arange(len(terms)))):
        words = [f"--rewards.{name}={weight}" for name, weight in zip(terms, weights, strict=True)]
        robots: Any = make_env(
            parse([*SMALL.split(), "--mixture", "flat", "1", "--effort-ramp", "0", *words])
        ).env.unwrapped
        robots.reset(seed=episode_seeds("training", 0, robots.num_envs).tolist())
        sums = np.zeros(len(terms))
        for step in range(100):
            wild = np.random.default_rng(step // 10).uniform(robots.action_space.low, robots.action_space.high)
            *_, infos = robots.step(wild.astype(np.float32))
            sums += [infos[f"reward_{name}"].sum() for name in terms]
        found.append(sums)
    assert found[0].all(), "or this shows nothing"
    np.testing.assert_allclose(found[1], found[0] * 2.0 ** (0.5 * np.arange(len(terms))), rtol=1e-6)


def test_another_robot_is_trained_and_validated_on_what_is_as_hard_for_it(tmp_path: Path) -> None:
    """At a length scale of 0.4 and a mass scale of 0.1, impulses scale by 0.1 · √0.4 and heights by 0.4."""
    alike(tmp_path)
    words = [*SMALL.split(), "--robot", str(tmp_path / "alike.xml"), "--curriculum", "0.5", "--ppo.envs", "64"]
    config = parse(words)
    with contextlib.closing(make_env(config)) as env:
        found = {each.scenario.axis: each.scenario.severity for each in env.env.unwrapped.batches}  # type: ignore[attr-defined]
    assert found["push"] == pytest.approx((20 * 50) ** 0.5 * 0.1 * 0.4**0.5, rel=0.01)
    assert found["rough"] == pytest.approx((0.06 * 0.18) ** 0.5 * 0.4, rel=0.01)
    judged = dataclasses.replace(config.validation, episodes=1, scenarios=("push",))
    with begun() as batches, pytest.MonkeyPatch.context() as patch:
        true_run = validation.run
        patch.setattr(validation, "run", lambda *args, **kwargs: true_run(*args, **kwargs | {"steps": BRIEF}))
        validation.validate(config.hardware.policy("stand"), judged, 1, config.hardware)
    assert [each.env.scenario.severity for each in batches] == [pytest.approx(35.0 * 0.1 * 0.4**0.5)]


def test_all_episodes_start_with_their_segment(monkeypatch: pytest.MonkeyPatch) -> None:
    """Each segment of two rollouts starts with the observations of its own seeds at the start of an episode."""
    config, begins = parse([*SMALL.split(), "--mixture", "flat", "1", "--max-episode-steps", "4"]), []
    env, twin = make_env(config), make_env(config)

    def noted(callback: TrainingCallback) -> None:
        buffer = callback.locals["rollout_buffer"]
        begins.append((buffer.episode_starts[0].all(), buffer.observations[0].copy()))

    for unused in ("_save_checkpoint", "_validate"):
        monkeypatch.setattr(TrainingCallback, unused, lambda _: None)
    monkeypatch.setattr(TrainingCallback, "_on_rollout_end", noted)
    callback = TrainingCallback(config, env, None, Interrupt(), CallbackState())  # type: ignore[arg-type]
    make_ppo(config, env).learn(6 * 8, callback)
    assert [start for start, _ in begins] == [True, False] * 3
    assert len({seen.tobytes() for _, seen in begins}) == 6
    for segment, (_, seen) in enumerate(begins[::2]):
        np.testing.assert_array_equal(seen, twin.reset_to_seeds(training_seeds(config, segment)))
