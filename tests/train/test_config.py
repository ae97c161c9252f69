"""Settings: a JSON round trip returns an equal value, and an invalid configuration raises an error of one line."""

import dataclasses
import json
from pathlib import Path
from typing import get_args

import pytest

from policies.residual_bases import BASES
from quad_env.cli.command_line import UsageError
from train.commands.run import parse
from train.config import DEFAULTS, MIXTURE, RECIPES, BaseName, PpoConfig, TrainConfig
from train.run import make_env
from train.run_folder import CONFIG_FILE
from train.run_record import differences, from_dict, to_dict, training_command
from train.training_robots import make_base, robots_per_scenario


@pytest.mark.parametrize("kind", DEFAULTS)
def test_settings_survive_json(kind):
    config = dataclasses.replace(DEFAULTS[kind], seed=7, mixture=(("flat", 0.25), ("rough", 0.75)))
    assert from_dict(json.loads(json.dumps(to_dict(config)))) == config


def test_where_a_run_is_written_and_with_how_many_threads_does_not_count_as_a_setting():
    config = TrainConfig()
    elsewhere = dataclasses.replace(config, out=Path("elsewhere"), resume=True, threads=7)
    assert to_dict(elsewhere) == to_dict(config)
    assert differences(config, elsewhere) == []


def test_differences_name_the_option_and_both_values():
    changed = dataclasses.replace(TrainConfig(), ppo=dataclasses.replace(PpoConfig(), gamma=0.5))
    (line,) = differences(TrainConfig(), changed)
    assert (line.option, line.old, line.new) == ("--ppo.gamma", PpoConfig().gamma, 0.5)


def test_settings_from_before_there_was_a_reward_of_the_feet_give_it_no_weight(tmp_path):
    settings = to_dict(dataclasses.replace(TrainConfig(), steps=777))
    assert settings["rewards"].pop("foot_air_time") == 0.0
    (tmp_path / CONFIG_FILE).write_text(json.dumps(settings), encoding="utf-8")
    assert parse(["--resume", "--out", str(tmp_path)]).rewards == TrainConfig().rewards


@pytest.mark.parametrize(
    "settings",
    [
        {"ppo": {"activation": "tanh"}},
        {"mixture": [["flat"]]},
        {"policy": "waltz"},
    ],
)
def test_what_is_no_configuration_is_refused(settings):
    with pytest.raises(UsageError, match="not a training configuration"):
        from_dict(settings)


@pytest.mark.parametrize(
    ("arguments", "complaint"),
    [
        ("--steps 0", "--steps must be from 1"),
        ("--steps 1.5", "'1.5' is no whole number"),
        ("--seed 4294967296", "--seed must be from 0 to 4294967295"),
        ("--hip-authority nan", "--hip-authority must be from 0"),
        ("--ppo.envs 65536 --ppo.rollout-steps 65536", "must be at most"),
        ("--rewards.fall inf", "--rewards.fall must be from"),
        ("--rewards.stumble 1", "--rewards.stumble"),
        ("--recipe joystick", "--recipe joystick is for --policy end-to-end"),
        ("--base trot --ppo.symmetry actor", "--ppo.symmetry needs --base crouch or stand"),
        ("--policy end-to-end --base trot", "--base crouch or stand, not on trot"),
        ("--ppo.envs 10 --ppo.rollout-steps 3 --ppo.minibatch 20", "must divide"),
        ("--mixture moon 1.0", "unknown scenario 'moon'"),
        ("--mixture flat -1.0", "not negative"),
        ("--mixture flat 0.5 flat 0.5", "twice"),
        ("--actuator steam", "unknown actuator 'steam'; valid: ideal, torque_speed, motor"),
        ("--sensors typical --mixture push+hardware 1.0", r"push\+hardware: the profile has its own --actuator"),
        ("--timestep 0.004", r"--timestep: .*whole number of physics steps, got 0\.004; valid: .*0\.0025, 0\.005"),
        ("--timestep 0.02", "--timestep must be from"),
        ("--solver-iterations 0", "--solver-iterations must be from 1"),
        ("--solver-iterations 8 --device cuda", "--solver-iterations: .*only --device cpu, got 8"),
        ("--resume --out no-such-folder", "no run in no-such-folder"),
    ],
)
def test_bad_input_is_one_line_that_names_it(arguments, complaint):
    with pytest.raises(UsageError, match=complaint) as caught:
        parse(arguments.split())
    assert "\n" not in str(caught.value)


def test_every_base_that_a_bundle_can_hold_can_be_trained_on():
    assert get_args(BaseName) == tuple(BASES)
    assert [parse(["--base", name]).base for name in BASES] == list(BASES)


def test_steps_of_the_physics_may_be_those_of_the_robot():
    words = "--timestep None --solver-iterations None --ppo.envs 2 --mixture flat 1 --threads 1"
    env = make_env(parse([*words.split(), "--ppo.minibatch", "24"]))
    option = env.env.unwrapped.batches[0].simulation.model.opt
    assert (option.timestep, option.iterations) == (0.002, 30)
    env.close()


def test_each_policy_has_its_own_defaults_and_options_override_them():
    usual = parse([])
    assert (usual.base, usual.joint_authority, usual.hip_authority) == ("trot_reference", 1.0, 0.6)
    assert parse(["--base", "trot_integral", "--hip-authority", "0.2"]).hip_authority == 0.2
    end_to_end = parse(["--policy", "end-to-end", "--hip-authority", "0.2"])
    assert end_to_end == dataclasses.replace(DEFAULTS["end-to-end"], hip_authority=0.2)
    assert end_to_end.base == "crouch"


def test_a_recipe_sets_robot_gains_and_options_and_others_override_it():
    recipe = ["--policy", "end-to-end", "--recipe", "joystick"]
    found = parse(recipe)
    assert found == RECIPES["joystick"]
    assert (found.robot, found.ppo.hold, found.correction) == ("go1", 2, "scaled")
    robot = make_base(found).robot
    assert (robot.servo_stiffness[0], robot.servo_damping[0]) == (35.0, 0.5)
    changed = dataclasses.replace(found, kicks=2.0, rewards=dataclasses.replace(found.rewards, gait=0.0))
    assert parse([*recipe, "--kicks", "2", "--rewards.gait", "0"]) == changed
    assert parse([*recipe, "--robot", "go2"]).robot == "go2"


@pytest.mark.parametrize(
    "changes", [{}, {"commands": "scenario", "robot": "simple_quad"}, {"kicks": 1.0, "base": "crouch", "robot": "go2"}]
)
def test_the_command_of_a_run_by_a_recipe_repeats_it(changes):
    config = dataclasses.replace(RECIPES["joystick"], **changes)
    words = training_command(config).split()
    assert parse(words[3:]) == config
    assert len(words) == 9 + 2 * len(changes)


def test_resume_takes_the_settings_of_the_run_and_refuses_others(tmp_path):
    begun = dataclasses.replace(TrainConfig(), steps=777, sensors="typical", ppo=PpoConfig(gamma=0.5))
    (tmp_path / CONFIG_FILE).write_text(json.dumps(to_dict(begun)), encoding="utf-8")
    resumed = parse(["--resume", "--out", str(tmp_path)])
    assert to_dict(resumed) == to_dict(begun)
    assert resumed.folder == tmp_path
    assert parse(["--resume", "--out", str(tmp_path), "--steps", "778"]).steps == 778
    for option, new in (("--steps", "776"), ("--ppo.gamma", "0.4"), ("--sensors", "truth"), ("--actuator", "motor")):
        with pytest.raises(UsageError, match=rf"{option}: the run has .*, the command {new}; only a larger --steps"):
            parse(["--resume", "--out", str(tmp_path), option, new])


@pytest.mark.parametrize("kind", DEFAULTS)
def test_weights_that_are_not_named_stay_as_they_are(kind):
    usual = DEFAULTS[kind].rewards
    found = parse(["--policy", kind, "--rewards.fall", "-2", "--rewards.roll-pitch-rate=-1"]).rewards
    assert found == dataclasses.replace(usual, fall=-2.0, roll_pitch_rate=-1.0)


@pytest.mark.parametrize("words", ["1e6", "1_000_000"])
def test_large_numbers_may_be_written_as_people_do(words):
    config = parse(["--steps", words, "--validation.interval", words])
    assert (config.steps, config.validation.interval) == (1_000_000, 1_000_000)
    assert type(config.steps) is int


@pytest.mark.parametrize(
    ("mixture", "robots", "expected"),
    [
        ((("flat", 1.0), ("push", 1.0), ("rough", 1.0)), 8, {"flat": 3, "push": 3, "rough": 2}),
        ((("flat", 3.0), ("push", 0.0)), 5, {"flat": 5}),
    ],
)
def test_robots_are_shared_out_to_the_last_one(mixture, robots, expected):
    config = dataclasses.replace(TrainConfig(), mixture=mixture, ppo=PpoConfig(envs=robots))
    assert robots_per_scenario(config) == expected


def test_a_run_is_validated_on_the_scenarios_that_it_trains_on_unless_others_are_given():
    assert parse([]).complete_validation.scenarios == tuple(name for name, _ in MIXTURE)
    mixture = ["--mixture", "latency=0.04", "0.5", "flat", "0", "payload=15+slope=10", "0.5"]
    assert parse(mixture).complete_validation.scenarios == ("latency=0.04", "payload=15+slope=10")
    assert parse([*mixture, "--validation.scenarios", "flat"]).complete_validation.scenarios == ("flat",)
