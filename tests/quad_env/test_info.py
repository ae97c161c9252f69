"""`python -m quad_env info` describes the environment."""

import re
from dataclasses import replace

import gymnasium as gym
import pytest

import quad_env
from evaluate.rollouts import battery
from quad_env import info
from quad_env.__main__ import COMMANDS, main
from quad_env.scenarios import listing


def test_it_says_what_the_environment_is(capsys) -> None:
    assert main(["info"]) == 0
    lines = capsys.readouterr().out.splitlines()
    text = "\n".join(" ".join(line.split()) for line in lines)
    assert max(map(len, lines)) <= 92
    env = gym.make("quad_env:SimpleQuad-v0")
    assert f"float32, shape {env.action_space.shape}:" in text
    assert f"float32, shape {env.observation_space.shape}" in text
    for name, part in quad_env.OBSERVATION.items():
        assert f"{part.start}:{part.stop} {name} " in text
    lowest, highest = env.action_space.low[2], env.action_space.high[2]
    assert f"fl_calf_joint {lowest:.2f} -1.00 {highest:.2f}" in text
    env.close()
    for name in (*quad_env.ACTUATORS, *quad_env.SENSORS, *quad_env.FALL_REASONS[1:]):
        assert name in text


def test_it_describes_the_robot_that_it_is_given() -> None:
    assert "robot        heavy: " in info.environment_text(replace(quad_env.SIMPLE_QUAD, name="heavy"))


def test_without_a_command_it_lists_them(capsys) -> None:
    assert main([]) == 0
    listed = [line.split()[0] for line in capsys.readouterr().out.splitlines()[1:]]
    simulation = ["view", "film", "record", "ros", "unitree", "drive"]
    assert listed == ["info", "describe", "doctor", "scenarios", "policies", *simulation]


def test_every_scenario_is_told_with_its_unit_its_levels_and_a_sentence(capsys) -> None:
    assert main(["scenarios"]) == 0
    text = " ".join(capsys.readouterr().out.split())
    for axis in quad_env.AXES.values():
        levels = " ".join(f"{level:g}" for level in axis.levels)
        unit = axis.unit if axis.unit in ("", "°") else f" {axis.unit}"
        assert (
            f"{axis.name} {axis.nominal:g}{unit} {axis.quantity}: {levels} {axis.sentence} {axis.note}".strip() in text
        )
        assert re.fullmatch(r"[A-Z].{15,}[a-z]\.", axis.sentence), axis.name


def test_the_scenarios_of_a_smaller_robot_are_those_that_are_as_hard_for_it() -> None:
    own = listing.text(replace(quad_env.SIMPLE_QUAD, name="short", thigh_length=0.075, calf_length=0.075))
    assert "for short:" in own
    assert "  stairs       0.025 m " in own
    assert "  push         17.5 N·s " in own


@pytest.mark.parametrize("written", [name for name in listing.SYNTAX_EXAMPLES if not battery.is_file_reference(name)])
def test_scenarios_can_be_written_as_the_examples_say(written) -> None:
    assert battery.resolve((written,), quad_env.SIMPLE_QUAD)


@pytest.mark.parametrize(
    ("arguments", "named"),
    [
        (["inof"], list(COMMANDS)),
        (["info", "--nonsense"], ["--help"]),
        (["info", "--robot", "nobody"], ["simple_quad", "go1"]),
        (["dataset", "mine/walk-v0"], ["examples/clients/minari_dataset.py"]),
    ],
)
def test_a_mistake_is_one_line_that_names_what_there_is(capsys, arguments, named) -> None:
    assert main(arguments) == 2
    printed = capsys.readouterr()
    assert (printed.out, printed.err.count("\n")) == ("", 1)
    assert printed.err.startswith("error: ")
    assert all(name in printed.err for name in named)
