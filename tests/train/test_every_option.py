"""Every option of `python -m train` reaches what it governs: given as words, seen on the robots, the learner, the run.

`EFFECTS` has an entry for each option; an option without one fails. Terms of the reward have a test of their own.
"""

import contextlib
import dataclasses
import json
import threading
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from stable_baselines3.common.callbacks import BaseCallback

from quad_env.config import RewardWeights
from quad_env.envs.vector_env import SimpleQuadVectorEnv
from quad_env.seeding import episode_seeds
from tests.batches import Batch, begun
from tests.effects import Effect, Reading
from tests.quad_env.robots.alike import alike
from train import run as training_run
from train import validation
from train.__main__ import main
from train.command import parse
from train.config import TrainConfig
from train.run import make_env
from train.run_folder import CONFIG_FILE, VALIDATIONS_FILE, steps_done
from train.sb3.callbacks import CallbackState, Segments, Session, current_policy
from train.sb3.ppo import build
from train.scenarios import TERRAIN_SEEDS
from train.training_robots import training_seeds

MIXTURE = "--mixture flat 0.5 push=60 0.25 rough=0.2 0.25"
USUAL = (
    "--threads 1 --seed 7 --curriculum 1 --inputs.lags --inputs.averages --validation.episodes 1 "
    "--validation.scenarios flat --ppo.envs 4 --ppo.rollout-steps 2 --ppo.minibatch 4 --ppo.epochs 1 --ppo.hold 1 "
    "--ppo.actor 4 --ppo.critic 4"
)
BRIEF = 120
"""Control steps of an episode of the validation."""
EPISODES = episode_seeds("training", 0, 4)
"""Seeds of the robots that are stepped here."""
STEPS, DT = 8, 0.01
"""Steps of a run, unless it is told others: one update. Control period, s."""


class Made:
    """What `python -m train` with these words makes, each part once it is asked for."""

    def __init__(self, words: str, folder: Path) -> None:
        given = words.replace("FOLDER", str(folder)).split()
        fixed = [] if "--mixture" in given or "--robot" in given else MIXTURE.split()
        fixed += [] if "--steps" in given else ["--steps", str(STEPS)]
        self.folder = folder
        self.words = [*USUAL.split(), *fixed, *given]
        if not {"--out", "--resume"} & set(given):
            self.words += ["--out", str(folder / "run")]

    @cached_property
    def config(self) -> TrainConfig:
        return parse(self.words)

    @cached_property
    def env(self) -> Any:
        """The robots as the learner sees them."""
        return make_env(self.config)

    @property
    def residual(self) -> Any:
        return self.env.env

    @property
    def robots(self) -> list[SimpleQuadVectorEnv]:
        """The batches."""
        return list(self.residual.unwrapped.batches)

    @cached_property
    def learner(self) -> Any:
        return build(self.config, self.env)

    @cached_property
    def shipped(self) -> Any:
        """The policy that a bundle of the run would hold."""
        return current_policy(self.config, self.learner)

    @cached_property
    def started(self) -> list[Batch]:
        """The batches that train, begun."""
        with begun() as found, contextlib.closing(make_env(self.config)) as env:
            env.reset()
        return found

    @cached_property
    def ran(self) -> "Ran":
        """A whole run."""
        learners, pools = [], set[str]()
        true_build, true_validate = training_run.build, validation.run

        def watched(*args: Any) -> Any:
            learners.append(true_build(*args))
            return learners[-1]

        def brief(*args: Any, **kwargs: Any) -> Any:
            pools.update(each.name for each in threading.enumerate() if each.name.startswith("robots"))
            return true_validate(*args, **kwargs | {"steps": BRIEF})

        with begun() as found, pytest.MonkeyPatch.context() as patch:
            patch.setattr(training_run, "build", watched)
            patch.setattr(validation, "run", brief)
            assert main(self.words) == 0
        return Ran(self.folder / "run", found, learners, len(pools))

    def steps(self, count: int, action: float = 0.0) -> Iterator[Any]:
        """What the environment of the learner's actions gives, at each of so many steps."""
        self.residual.reset(seed=EPISODES[: self.env.num_envs].tolist())
        for _ in range(count):
            yield self.residual.step(np.full(self.residual.action_space.shape, action, np.float32))


@dataclass(frozen=True)
class Ran:
    """A run that came to its end."""

    folder: Path
    batches: list[Batch]
    learners: list[Any]
    pool: int
    """Threads that stepped batches side by side."""

    @property
    def validations(self) -> list[dict[str, Any]]:
        return list(json.loads((self.folder / VALIDATIONS_FILE).read_bytes())["validations"])

    @property
    def remembered(self) -> dict[str, Any]:
        """What the callbacks carry on with, of the last checkpoint."""
        return dict(json.loads(max(self.folder.glob("checkpoints/*.json")).read_bytes())["remembered"])

    def judged(self) -> list[Batch]:
        """The batches of the validations."""
        return [each for each in self.batches if each.purpose == "validation"]


def of_both(read: Callable[[Any], Any]) -> Reading:
    """A reading of the environment that the learner moves, and of the policy that it leaves."""
    return lambda made: (read(made.residual), read(made.shipped))


def authority(each: Any) -> list[float]:
    """Of hip, thigh and calf."""
    return [round(float(value), 6) for value in each.authority[:3]]


def both(value: Any) -> tuple[Any, Any]:
    return value, value


def severities(made: Made) -> dict[str, Any]:
    """Of scenarios, by axis."""
    return {each.scenario.axis: each.scenario.severity for each in made.robots}


def features(made: Made, count: int) -> np.ndarray:
    """What the learner saw of the first robot, a row a step."""
    return np.array([seen[0] for seen, *_ in made.steps(count)])


def remembered(made: Made) -> tuple[np.ndarray, np.ndarray]:
    """The scaled observation of each step, and what is remembered of those before."""
    seen = features(made, 12)
    width = made.robots[0].observation_table.size
    return seen[:, :width], seen[:, -width:]


def lag(made: Made) -> float | None:
    """Age of the observation that is remembered, s."""
    now, then = remembered(made)
    ages = [age for age in range(1, 8) if np.array_equal(then[age + 1 :], now[1:-age])]
    return ages[0] * DT if len(ages) == 1 else None


def averaging_time(made: Made) -> float:
    """Time constant of the average that is remembered, s."""
    now, then = remembered(made)
    missing = now[1:] - then[:-1]
    rates = (then[1:] - then[:-1])[missing != 0.0] / missing[missing != 0.0]
    return round(float(-DT / np.log1p(-np.median(rates))), 2)


def clock(made: Made) -> float:
    """Frequency of the clock that is seen last, Hz."""
    sine, cosine = features(made, 3)[:, -2:].T
    return round(float(np.diff(np.unwrap(np.arctan2(sine, cosine)))[0] / (2 * np.pi * DT)), 2)


def first_episodes(made: Made) -> list[int]:
    """Control steps of each robot's first episode; 0 of one that goes on."""
    lengths = np.zeros(made.env.num_envs, int)
    for *_, ended, infos in made.steps(20):
        new = ended & (lengths == 0)
        lengths[new] = infos["final_info"]["episode"]["l"][new] if new.any() else 0
    return list(lengths.tolist())


def cut_somewhere(longest: int) -> list[int]:
    """Lengths of first episodes that are drawn by the robots' seeds, so that not all end together."""
    drawn = np.random.default_rng(EPISODES.tolist()).integers(1, longest, len(EPISODES), endpoint=True)
    return list(drawn.tolist())


def kinds_of_robots(read: Callable[[Batch], Any]) -> Reading:
    """What all robots of a run have, by what they are for."""
    return lambda made: {(each.purpose, read(each)) for each in made.ran.batches}


def alike_everywhere(value: Any) -> set[tuple[str, Any]]:
    return {("training", value), ("validation", value)}


def own_term(made: Made) -> Any:
    """What a term of the user's pays in a step."""
    *_, infos = next(made.steps(1))
    return infos.get("reward_always", np.zeros(1))[0]


def learner(read: Callable[[Any], Any]) -> Reading:
    return lambda made: read(made.learner)


def seeded(made: Made) -> tuple[Any, ...]:
    """Seeds of the learner, of the robots' episodes and of their rough ground."""
    episodes = [seed for each in made.started for seed in each.seeds]
    return made.learner.seed, episodes, made.robots[2].scenario.terrain.seed  # type: ignore[union-attr]


def noise_at_the_end(made: Made) -> tuple[float, bool]:
    """Logarithm of the exploration noise after the run, whose last rollout began in the middle; whether it is
    learned."""
    noise = made.ran.learners[-1].policy.log_std
    return round(noise.tolist()[0], 3), noise.requires_grad


def threads(made: Made) -> tuple[set[tuple[str, int]], int]:
    """Of the batches by what they are for, and those that step batches side by side."""
    return {(each.purpose, each.threads) for each in made.ran.batches}, made.ran.pool


def folders(made: Made) -> dict[str, tuple[int, int]]:
    """Seed that is written in each run's folder, and that of its learner, in the order of the runs."""
    runs = sorted(made.folder.rglob(CONFIG_FILE)) if (ran := made.ran) else []
    found = zip(runs, ran.learners, strict=True)
    return {
        str(path.parent.relative_to(made.folder)): (json.loads(path.read_bytes())["seed"], each.seed)
        for path, each in found
    }


ADAPTIVE = "--ppo.learning-rate-schedule adaptive"
EFFECTS = {
    "policy": Effect(
        "--policy end-to-end", lambda made: (made.shipped.name, made.residual.base.name), ("end-to-end", "crouch")
    ),
    "base": Effect("--base trot_feedback", of_both(lambda each: each.base.name), both("trot_feedback")),
    "steps": Effect("--steps 24", lambda made: steps_done(made.ran.folder), 24),
    "seed": Effect("--seed 8", seeded, (8, episode_seeds("training", 8, 4).tolist(), TERRAIN_SEEDS["training"] + 8)),
    "seeds": Effect("--seeds 2", folders, {"run/seed-7": (7, 7), "run/seed-8": (8, 8)}),
    "out": Effect("--out FOLDER/elsewhere", folders, {"elsewhere": (7, 7)}),
    "threads": Effect("--threads 5", threads, ({("training", 5), ("validation", 5)}, 0)),
    "joint_authority": Effect("--joint-authority 0.2", of_both(authority), both([0.15, 0.2, 0.2])),
    "hip_authority": Effect("--hip-authority 0.1", of_both(authority), both([0.1, 0.3, 0.3])),
    "foothold_authority": Effect(
        "--foothold-authority 0.05",
        of_both(lambda each: each.shift_authority.round(6).tolist()),
        both(np.full(2, 0.05, np.float32).round(6).tolist()),
        given="--base mpc",
    ),
    "inputs.lags": Effect("--inputs.lags 0.03", lag, 0.03),
    "inputs.averages": Effect("--inputs.averages 0.2", averaging_time, 0.2),
    "inputs.clock": Effect("--inputs.clock 4", clock, 4.0),
    "mixture": Effect(
        "--mixture push=60 1 slope=20 3",
        lambda made: {each.scenario.name: each.num_envs for each in made.robots},
        {"push=60": 1, "slope=20": 3},
    ),
    "curriculum": Effect(
        "--curriculum 0.5",  # of the way from 1 m/s, 20 N·s and 0.06 m, on a scale of their logarithms
        lambda made: severities(made) | {"shares": made.ran.remembered["shares"]},
        {
            "flat": pytest.approx(1.5**0.5),
            "push": pytest.approx((20 * 60) ** 0.5),
            "rough": pytest.approx((0.06 * 0.2) ** 0.5),
            "shares": [0.5] * 3,
        },
    ),
    "max_episode_steps": Effect("--max-episode-steps 20", first_episodes, cut_somewhere(20)),
    "robot": Effect(
        "--robot FOLDER/alike.xml",
        lambda made: (*of_both(lambda each: each.base.robot.name)(made), *{each.robot.name for each in made.robots}),
        ("alike",) * 3,
    ),
    "actuator": Effect(
        "--actuator motor",
        kinds_of_robots(lambda each: each.warms),
        alike_everywhere(True),
    ),
    "sensors": Effect("--sensors typical", kinds_of_robots(lambda each: each.sensed), alike_everywhere(True)),
    "estimator": Effect(
        "--estimator kalman",
        kinds_of_robots(lambda each: type(each.env.estimator).__name__),
        alike_everywhere("KalmanFilter"),
        given="--sensors typical",
    ),
    "reward_terms": Effect("--reward-terms FOLDER/own.py:always=5", own_term, pytest.approx(5 * DT)),
    "ppo.learning_rate_schedule": Effect(
        "--ppo.learning-rate-schedule constant", learner(lambda each: each.lr_schedule(0.25)), 1e-3
    ),
    "ppo.target_kl": Effect(
        "--ppo.target-kl 0.02", learner(lambda each: each.learning_rate.target_kl), 0.02, given=ADAPTIVE
    ),
    "ppo.hold": Effect(
        "--ppo.hold 3", lambda made: (int(next(made.steps(1))[4]["episode"]["l"][0]), made.shipped.hold), both(3)
    ),
    "ppo.log_std_final": Effect("--ppo.log-std-final -3.2 --steps 16", noise_at_the_end, (-2.2, False)),
    "validation.interval": Effect(
        "--validation.interval 8",
        lambda made: [each["steps"] for each in made.ran.validations],
        [8, 16, 24],
        given="--steps 24",
    ),
    "validation.episodes": Effect(
        "--validation.episodes 3", lambda made: [len(each.seeds) for each in made.ran.judged()], [3]
    ),
    "validation.scenarios": Effect(
        "--validation.scenarios push rough=0.1",
        lambda made: [each.env.scenario.name for each in made.ran.judged()],
        ["push", "rough=0.1"],
    ),
}
OF_ITS_OWN = {"resume", "rewards"}
"""Options with a test of their own, here and in test_command.py."""
OF_THE_LEARNER = {"envs", "rollout_steps", "minibatch", "epochs", "learning_rate", "gamma", "gae_lambda", "entropy"} | {
    *("log_std_init", "actor", "critic")
}
"""Options of `--ppo` that `tests/planted_faults/test_training_faults.py` looks for in the learner."""


def options(config: Any, prefix: str = "") -> Iterator[str]:
    """Names of all options, those of groups with the group's."""
    for field in dataclasses.fields(config):
        value = getattr(config, field.name)
        if dataclasses.is_dataclass(value) and field.name != "rewards":
            yield from options(value, f"{prefix}{field.name}.")
        else:
            yield prefix + field.name


def test_every_option_has_an_effect_that_is_tested() -> None:
    assert set(options(TrainConfig())) == EFFECTS.keys() | OF_ITS_OWN | {f"ppo.{each}" for each in OF_THE_LEARNER}


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("usual")


@pytest.fixture(scope="module")
def usual(folder: Path) -> Callable[[str], Made]:
    """What is made with nothing but what an option needs."""
    made: dict[str, Made] = {}

    def of(given: str) -> Made:
        place = folder / str(len(made))
        return made.setdefault(given, Made(given, place))

    return of


@pytest.mark.parametrize("option", EFFECTS)
def test_an_option_reaches_what_it_governs(option: str, usual: Callable[[str], Made], tmp_path: Path) -> None:
    effect = EFFECTS[option]
    (tmp_path / "own.py").write_text("def always(state):\n    return state.height * 0 + 1\n")
    if option == "robot":
        alike(tmp_path)
    effect.check(usual(effect.given), Made(f"{effect.given} {effect.words}", tmp_path))


TERMS = tuple(field.name for field in dataclasses.fields(RewardWeights))


def test_the_weight_of_a_reward_term_is_what_robots_earn_by(folder: Path) -> None:
    """Over the same falls: all terms of weight 1, then each of twice the weight of the one before."""
    found = []
    for number, weights in enumerate(((1.0,) * len(TERMS), 2.0 ** np.arange(len(TERMS)))):
        words = [f"{name}={weight}" for name, weight in zip(TERMS, weights, strict=True)]
        robots = Made(f"--rewards {' '.join(words)}", folder / f"weights-{number}").residual.unwrapped
        robots.reset(seed=episode_seeds("training", 0, robots.num_envs).tolist())
        sums = np.zeros(len(TERMS))
        for step in range(100):
            wild = np.random.default_rng(step // 10).uniform(robots.action_space.low, robots.action_space.high)
            *_, infos = robots.step(wild.astype(np.float32))
            sums += [infos[f"reward_{name}"].sum() for name in TERMS]
        found.append(sums)
    assert found[0].all(), "or this shows nothing"
    np.testing.assert_allclose(found[1], found[0] * 2.0 ** np.arange(len(TERMS)), rtol=1e-6)


def test_another_robot_is_trained_on_what_is_as_hard_for_it(tmp_path: Path) -> None:
    """At a length of 0.4 and a tenth of the mass impulses go by 0.1 · √0.4, heights by 0.4; from the mildest level."""
    alike(tmp_path)
    made = Made(f"--robot {tmp_path / 'alike.xml'} --curriculum 0.5 --ppo.envs 64 --ppo.minibatch 128", tmp_path)
    found = severities(made)
    assert found["push"] == pytest.approx((20 * 55) ** 0.5 * 0.1 * 0.4**0.5, rel=0.01)
    assert found["rough"] == pytest.approx((0.06 * 0.2) ** 0.5 * 0.4, rel=0.01)
    assert found["payload"] == pytest.approx(
        0.1 * severities(Made("--mixture payload=20 1 --curriculum 0.5", tmp_path))["payload"], rel=0.01
    )


def test_a_robot_is_validated_on_its_own_scenarios(tmp_path: Path) -> None:
    alike(tmp_path)
    (judged,) = Made(f"--robot {tmp_path / 'alike.xml'} --validation.scenarios push", tmp_path).ran.judged()
    assert judged.env.scenario.severity == pytest.approx(35.0 * 0.1 * 0.4**0.5)


def test_all_episodes_start_with_their_segment(tmp_path: Path) -> None:
    """Segments of two rollouts: each begins with the observations of its own seeds, as the begin of an episode."""
    made, twin, begins = Made("--max-episode-steps 4", tmp_path), Made("--max-episode-steps 4", tmp_path), []

    class Watch(BaseCallback):
        def _on_step(self) -> bool:
            return True

        def _on_rollout_end(self) -> None:
            buffer = self.locals["rollout_buffer"]
            begins.append((buffer.episode_starts[0].all(), buffer.observations[0].copy()))

    session = Session(made.config, made.env, None, None, CallbackState())  # type: ignore[arg-type]
    made.learner.learn(6 * 8, [Segments(session), Watch()])
    assert [start for start, _ in begins] == [True, False] * 3
    for segment, (_, seen) in enumerate(begins[::2]):
        np.testing.assert_array_equal(seen, twin.env.begin(training_seeds(made.config, segment)))
