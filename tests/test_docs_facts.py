"""Limits, defaults and names in README and docs equal those of the code.

`FACTS` has a statement of a page as a pattern whose groups are the numbers, and the numbers in the code. A statement
that is no longer found fails as well: change the pattern together with the page.
"""

import importlib
import math
import re
import tomllib
from collections.abc import Callable, Iterator, Sequence
from functools import cache
from pathlib import Path
from typing import Any

import gymnasium as gym
import pytest

import quad_env
from evaluate.analysis import ranking
from evaluate.commands.options import EPISODES
from evaluate.film import files, page, scene, shooting
from evaluate.measures import outcomes, tracking
from evaluate.statistics import intervals, sequential
from live import session
from live.commands.drive import DriveOptions
from live.ros import bridge, node
from live.unitree import command_guard, driver, low_level_robot, motors, server
from live.view import controller, render_thread
from policies import residual
from policies.behaviour.transitions import TIME_LIMIT
from quad_env import SIMPLE_QUAD, CommandRanges, FallRule, RewardWeights, TaskConfig
from quad_env.envs.home_pose import AUTHORITY
from quad_env.scenarios.registry import STEADY
from tests.test_docs import PAGES, help_of, named_by, table
from train import config, curriculum
from train.sb3 import callbacks
from train.search import trials

ROOT = Path(__file__).parents[1]
PACKAGES = "quad_env", "policies", "evaluate", "train", "live", "research", "benchmarks", "examples"
SUCCESS = outcomes.RULES[outcomes.SUCCESS_RULE]
ISAAC_LAB = outcomes.RULES[outcomes.ISAAC_LAB]
HIP, JOINT, _ = residual.authority_of(SIMPLE_QUAD)[:3]
NUMBER = r"(−?[\d.]+)"
Fact = tuple[str, str, Callable[[], Sequence[float]]]
FACTS: list[Fact] = [
    ("README.md", "Python 3.(11) or newer", lambda: [int(_project("requires-python").rpartition(".")[2])]),
    ("docs/environment.md", f"servo tracks them at {NUMBER} Hz", lambda: [1 / _timestep()]),
    (
        "docs/environment.md",
        rf"\| {NUMBER} Hz; an episode has {NUMBER} steps",
        lambda: [_config().control_rate, _steps()],
    ),
    (
        "docs/environment.md",
        f"forward {NUMBER} … {NUMBER} m/s, lateral ±{NUMBER} m/s, yaw rate ±{NUMBER} rad/s, drawn at reset and every "
        f"{NUMBER} s",
        lambda: [*_commands().forward, _commands().lateral[1], _commands().yaw_rate[1], _commands().interval],
    ),
    (
        "docs/environment.md",
        f"its tilt exceeds {NUMBER}°, or its centre is lower than {NUMBER} m",
        lambda: [math.degrees(FallRule().tilt), FallRule().min_trunk_height(SIMPLE_QUAD.leg_length)],
    ),
    (
        "docs/environment.md",
        f"Without it the servos have the robot's own gains: SimpleQuad's {NUMBER} and {NUMBER}",
        lambda: [SIMPLE_QUAD.servo_stiffness[0], SIMPLE_QUAD.servo_damping[0]],
    ),
    ("docs/environment.md", rf"gives up to {NUMBER} N·m at any speed", lambda: [SIMPLE_QUAD.rated_torque]),
    ("docs/environment.md", f"By default the grid has {NUMBER} × {NUMBER} points {NUMBER} m apart", lambda: _grid()),
    ("docs/environment.md", f"and {NUMBER} m/s straight ahead for every robot", lambda: [STEADY.commands.forward[0]]),
    (
        "docs/numbers.md",
        f"its tilt exceeds {NUMBER}°, or its trunk's centre is lower than {NUMBER} m",
        lambda: [math.degrees(FallRule().tilt), FallRule().min_trunk_height(SIMPLE_QUAD.leg_length)],
    ),
    (
        "docs/numbers.md",
        rf"‖mean velocity − command‖ ≤ {NUMBER} m/s \+ {NUMBER} % of the command and \|mean yaw rate − command\| ≤ "
        rf"{NUMBER} rad/s \+ {NUMBER} %",
        lambda: [SUCCESS.linear, 100 * SUCCESS.share, SUCCESS.angular, 100 * SUCCESS.share],
    ),
    (
        "docs/numbers.md",
        f"in an interval that commands more than {NUMBER} m/s the robot covered less than a quarter",
        lambda: [outcomes.MOVING * (outcomes.MIN_PROGRESS == 0.25)],
    ),
    (
        "docs/numbers.md",
        f"mean velocity error below {NUMBER} m/s and mean yaw-rate error below {NUMBER} rad/s",
        lambda: [ISAAC_LAB.linear, ISAAC_LAB.angular],
    ),
    (
        "docs/numbers.md",
        f"A step's error is capped at {NUMBER} m/s and {NUMBER} rad/s",
        lambda: [tracking.VELOCITY_CAP, tracking.YAW_RATE_CAP],
    ),
    ("docs/numbers.md", f"with a chance of {NUMBER} % at the corrected level", lambda: [100 * ranking.POWER]),
    ("docs/numbers.md", f"Wilson's {NUMBER} % interval", lambda: [100 * intervals.CONFIDENCE]),
    ("docs/numbers.md", f"the chance of any wrong claim on neighbours at {NUMBER} %", lambda: [100 * sequential.LEVEL]),
    ("docs/numbers.md", rf"predictive power below {NUMBER} %", lambda: [100 * sequential.FUTILITY_POWER]),
    (
        "docs/numbers.md",
        f"simulates a quarter of at most {NUMBER} episodes",
        lambda: [EPISODES["settled"] * _quarters()],
    ),
    ("docs/numbers.md", f"Physics runs at steps of {NUMBER} ms", lambda: [1000 * _timestep()]),
    ("docs/commands.md", f"adds episodes, at most {NUMBER} or", lambda: [EPISODES["settled"]]),
    (
        "docs/design.md",
        f"by default to {NUMBER} rad per joint and {NUMBER} rad at the hips",
        lambda: [config.TrainConfig().joint_authority, config.TrainConfig().hip_authority],
    ),
    ("docs/mathematics.md", f"authority .A. of {NUMBER} rad at the hips and {NUMBER} rad", lambda: [HIP, JOINT]),
    (
        "docs/training.md",
        f"corrected by at most {NUMBER} rad per joint, {NUMBER} rad at the hips",
        lambda: [config.TrainConfig().joint_authority, config.TrainConfig().hip_authority],
    ),
    ("docs/tutorial.md", f"by at most {NUMBER} rad per joint", lambda: [config.TrainConfig().joint_authority]),
    (
        "docs/training.md",
        f"while more than {NUMBER} % of the command intervals are within tolerance, twice as fast above {NUMBER} %, "
        f"and lowers it below {NUMBER} %",
        lambda: [100 * curriculum.PROMOTION_RATE, 100 * curriculum.FAST_PROMOTION_RATE, 100 * curriculum.DEMOTION_RATE],
    ),
    (
        "docs/training.md",
        f"steps of {NUMBER} ms and at most {NUMBER} iterations",
        lambda: [1000 * config.TIMESTEP, config.SOLVER_ITERATIONS],
    ),
    (
        "docs/training.md",
        f"The first checkpoint is written within {NUMBER} s",
        lambda: [callbacks.FIRST_CHECKPOINT_DEADLINE],
    ),
    (
        "docs/training.md",
        f"An episode that succeeds costs {NUMBER}, one off its command {NUMBER}, one that stalls {NUMBER}, "
        f"a fall {NUMBER}",
        lambda: [trials.OUTCOME_COSTS[name] for name in ("succeeded", "off_command", "stalled", "fell")],
    ),
    ("docs/other_software.md", f"authority={NUMBER}.` maps", lambda: [AUTHORITY]),
    ("docs/view.md", f"joint targets blend within {NUMBER} s", lambda: [session.POLICY_BLEND_TIME]),
    ("docs/view.md", f"direction relative to the robot, impulse, over {NUMBER} s", lambda: [controller.PUSH_TIME]),
    ("docs/view.md", f"yellow: mean velocity over {NUMBER} s", lambda: [scene.VELOCITY_WINDOW]),
    ("docs/view.md", f"plainly and small, {NUMBER} × {NUMBER}", lambda: [render_thread.WIDTH, render_thread.HEIGHT]),
    ("docs/view.md", f"up to {NUMBER} million pixels", lambda: [files.MAX_PIXELS / 1e6]),
    (
        "docs/view.md",
        f"the film, {NUMBER} frames per second until {NUMBER} s after a fall",
        lambda: [page.PAGE_RENDER_OPTIONS.rate, shooting.POST_FALL_TIME],
    ),
    ("docs/view.md", "a strip of (twelve) frames", lambda: [files.STRIP_FRAMES]),
    (
        "docs/ros.md",
        f"it blends to them within {NUMBER} s",
        lambda: [bridge.JOIN_TIME],
    ),
    ("docs/ros.md", f"returns to the home pose within {NUMBER} s", lambda: [bridge.HOME_TIME]),
    (
        "docs/ros.md",
        rf"`/joint_states` \| `sensor_msgs/JointState` \| out, {NUMBER} Hz",
        lambda: [1 / node.JOINT_STATE_PERIOD],
    ),
    ("docs/ros.md", f"velocities beyond ±{NUMBER} are ignored", lambda: [quad_env.config.COMMAND_BOUND]),
    ("docs/unitree.md", f"out, {NUMBER} Hz", lambda: [low_level_robot.RATE]),
    ("docs/unitree.md", f"sensors that are read {NUMBER} times per second", lambda: [low_level_robot.SENSOR_RATE]),
    (
        "docs/unitree.md",
        f"motors are damped, with {NUMBER} N·m·s/rad and no stiffness: before the first command, {NUMBER} s after",
        lambda: [motors.DAMPING, command_guard.COMMAND_TIMEOUT],
    ),
    ("docs/unitree.md", f"messages arrive at more than {NUMBER} Hz", lambda: [command_guard.MAX_RATE]),
    ("docs/unitree.md", f"began more than {NUMBER} ms late", lambda: [1000 * server.MAX_LATENESS]),
    ("docs/unitree.md", f"the home pose within {NUMBER} s", lambda: [driver.STAND_TIME]),
    ("docs/unitree.md", f"zero {NUMBER} s after its last message", lambda: [driver.REMOTE_TIMEOUT]),
    (
        "docs/unitree.md",
        f"tilted by more than {NUMBER}°, or a joint is {NUMBER} rad beyond",
        lambda: [round(math.degrees(driver.MAX_TILT)), driver.JOINT_MARGIN],
    ),
    ("docs/unitree.md", f"no state has arrived for {NUMBER} s", lambda: [DriveOptions().state_timeout]),
    (
        "docs/behaviour.md",
        f"jump {NUMBER} s, fall {NUMBER} s, recover {NUMBER} s",
        lambda: list(TIME_LIMIT.values()),
    ),
]
WORDS = {"twelve": 12.0}


def _config() -> TaskConfig:
    return TaskConfig()


def _commands() -> CommandRanges:
    return CommandRanges()


def _timestep() -> float:
    return float(gym.make(quad_env.ENV_ID).unwrapped.model.opt.timestep)  # type: ignore[attr-defined]


def _steps() -> float:
    steps = gym.spec(quad_env.ENV_ID).max_episode_steps
    assert steps is not None
    return steps


def _grid() -> list[float]:
    scan = quad_env.HeightScan()
    return [scan.ahead + scan.behind + 1, 2 * scan.aside + 1, scan.spacing]


def _quarters() -> bool:
    """Return True if there are four interim analyses."""
    return sequential.LOOKS == 4


def _project(key: str) -> str:
    (value,) = re.findall(rf'^{key} = "(.*)"$', (ROOT / "pyproject.toml").read_text(encoding="utf-8"), re.MULTILINE)
    return str(value)


@pytest.mark.parametrize(
    ("name", "pattern", "right"), FACTS, ids=lambda value: value[:50] if isinstance(value, str) else ""
)
def test_a_stated_number_is_the_codes(name: str, pattern: str, right: Callable[[], Sequence[float]]) -> None:
    found = re.findall(pattern, PAGES[name])
    assert found, "the page no longer says so"
    for groups in found:
        texts = groups if isinstance(groups, tuple) else (groups,)
        stated = [WORDS.get(text) or float(text.replace("−", "-").rstrip(".")) for text in texts]
        assert stated == pytest.approx([float(value) for value in right()])


@cache
def _resolve(name: str) -> Any:
    """Return the object of a dotted name: a module, and attributes of it."""
    words = name.split(".")
    found: Any = importlib.import_module(words[0])
    for number, word in enumerate(words[1:], 2):
        if hasattr(found, word):
            found = getattr(found, word)
        elif (fields := getattr(found, "__dataclass_fields__", {})) and word in fields:
            found = fields[word]
        else:
            found = importlib.import_module(".".join(words[:number]))
    return found


def code(page: str) -> list[str]:
    """Return the texts between back quotes outside of fences."""
    return re.findall(r"`([^`\n]+)`", re.sub(r"^ *```.*?^ *```$", "", PAGES[page], flags=re.DOTALL | re.MULTILINE))


@pytest.mark.parametrize("page", PAGES)
def test_a_dotted_name_of_the_project_exists(page: str) -> None:
    wrong = []
    for text in code(page):
        for name in re.findall(rf"(?<![\w./-])((?:{'|'.join(PACKAGES)})(?:\.[A-Za-z_]\w*)+)(?![\w/])", text):
            if name.endswith((".md", ".py", ".toml", ".parquet")) or (ROOT / name).exists():
                continue
            try:
                _resolve(name)
            except (ImportError, AttributeError):
                wrong.append(name)
    assert wrong == []


@pytest.mark.parametrize("page", PAGES)
def test_a_name_said_to_be_in_a_file_is_there(page: str) -> None:
    """Examples are "`MAKERS` of `policies/registry.py`" and "`BASES` in `policies/residual_bases.py`"."""
    said = re.findall(r"`([A-Za-z_][\w.]*)` (?:of|in) `([\w/]+\.py)`", PAGES[page])
    said += [(name, file) for file, name in re.findall(r"`([\w/]+\.py)`: .*? in `([A-Z_]{3,})`", PAGES[page])]
    for name, file in said:
        text = (ROOT / file).read_text(encoding="utf-8")
        for word in name.split("."):
            assert re.search(rf"^ *(def |class )?{word}\b *[:(=]|^class {word}\b", text, re.MULTILINE), (name, file)


def all_options() -> Iterator[str]:
    """Return the options of every command of the project."""
    for package in PACKAGES[:-1]:
        commands = ([], *(name.split() for name in named_by(package))) if package not in ("policies", "live") else ()
        for words in commands:
            yield from re.findall(r"--[\w.-]+", help_of(package, *words))
    yield from re.findall(r"--[\w.-]+", help_of("train", "--teacher"))
    for package in sorted(set(re.findall(r"python -m (benchmarks\.\w+)", "".join(PAGES.values())))):
        yield from re.findall(r"--[\w.-]+", help_of(package))


@pytest.fixture(scope="module")
def options() -> frozenset[str]:
    return frozenset(all_options())


@pytest.mark.parametrize("page", [name for name in PAGES if name != "CONTRIBUTING.md"])
def test_an_option_that_is_named_exists(page: str, options: frozenset[str]) -> None:
    others = {"--help", "--help-all", "--keep-going", "--rewards.height-above-ground"}  # the last one is an example
    others |= {"--array", "--constraint", "--dependency", "--wrap"}  # options of sbatch
    others |= {"--address", "--head"}  # options of `ray start`
    others |= {"--headless"}  # option of the program that `python -m train export --to` writes
    named = {option for text in code(page) for option in re.findall(r"(?<![\w-])--[a-z][\w.-]*", text)}
    assert named - options - others == set()


def test_every_extra_has_its_row() -> None:
    rows = table("| extra | for |", "docs/install.md")
    shown = [name.strip(" `") for names, _ in rows for name in names.split(",")]
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    assert sorted(shown) == sorted(project["optional-dependencies"])


def test_every_weight_has_a_reward_term_of_its_name() -> None:
    """The weights are those in docs/extending.md."""
    from quad_env.task import rewards

    names = [name for name in RewardWeights.__dataclass_fields__ if name != "fall"]
    assert [*RewardWeights.__dataclass_fields__][-1] == "fall"
    assert all(callable(getattr(rewards, name)) for name in names)
