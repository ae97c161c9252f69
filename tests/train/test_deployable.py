"""Training of policies on quantities that a robot measures: defaults, the observations of each network, and errors."""

import json
from dataclasses import replace

import numpy as np
import pytest
import torch

import policies
from policies.bundle import load
from policies.history import Inputs
from policies.input_terms import DEPLOYABLE_TERMS
from quad_env import OBSERVATION, OBSERVATION_SIZE
from quad_env.cli.interrupt import Interrupt
from quad_env.robots.registry import get_robot
from quad_env.robots.simple_quad import SIMPLE_QUAD
from quad_env.scenarios.registry import scenario
from quad_env.task.observations import observation_table
from research.training.model_card import describe_inputs
from research.training.trained_run import load_trained_run
from train.__main__ import main
from train.commands import distil
from train.commands.run import parse
from train.deployable import hardware_mixture, observations_of
from train.distillation.config import DistillationConfig, distillation_command
from train.distillation.run import Distillation, make_robots
from train.distillation.run import evaluation_command as distillation_evaluation
from train.distillation.teacher import PrivilegedTeacher, make_teacher, student_inputs
from train.run import make_env
from train.run_record import evaluation_command, training_command
from train.sb3.ppo import make_ppo

STUDENT = ["--teacher", "trot", "--observations", "deployable"]
PPO = ["--policy", "end-to-end", "--observations", "deployable"]
SMALL_STUDENT_OPTIONS = (
    "--labels 40 --envs 2 --round-steps 10 --fit.hidden 8 --fit.round-updates 1 --fit.final-updates 1 "
    "--fit.minibatch 8 --mixture flat+hardware 1 --validation.interval 0 --validation.episodes 1 "
    "--validation.scenarios flat --threads 1"
)
SMALL_STUDENT = SMALL_STUDENT_OPTIONS.split()
SMALL_PPO_OPTIONS = (
    "--threads 1 --mixture flat+hardware 1 push:1+hardware 1 --ppo.envs 4 --ppo.rollout-steps 4 --ppo.minibatch 8 "
    "--ppo.epochs 1 --ppo.actor 8 --ppo.critic 8 --validation.interval 0 --validation.episodes 1 "
    "--validation.scenarios flat+hardware --max-episode-steps 20 --steps 16"
)
SMALL_PPO = SMALL_PPO_OPTIONS.split()


@pytest.fixture(scope="module")
def student(tmp_path_factory):
    """Return the folder of a small distillation with deployable observations."""
    folder = tmp_path_factory.mktemp("runs") / "student"
    assert main([*STUDENT, *SMALL_STUDENT, "--out", str(folder)]) == 0
    return folder


def assert_on_randomised_hardware(mixture):
    for name, _ in mixture:
        robots = scenario(name)
        assert robots.hardware
        assert robots.randomisation is not None


def test_a_student_for_robots_has_measured_inputs_at_50_hz_and_randomised_hardware():
    config = distil.parse(STUDENT)
    assert config.inputs == Inputs(terms=DEPLOYABLE_TERMS, history=10)
    assert (config.hold, config.clock, config.position_error) == (2, "constant", "none")
    assert_on_randomised_hardware(config.mixture)
    assert all(scenario(name).hardware for name in config.validation.scenarios)
    assert config.folder.name == "simple_quad-deployable-0"
    assert distil.parse([*STUDENT, "--hold", "1", "--inputs.history", "3"]).inputs.history == 3


def test_a_student_without_the_option_has_the_inputs_of_before():
    assert distil.parse(["--teacher", "trot"]) == DistillationConfig(teacher="trot")


@pytest.mark.parametrize("recipe", ["default", "joystick"])
def test_ppo_for_robots_has_measured_inputs_at_50_hz_and_randomised_hardware(recipe):
    config = parse([*PPO, "--recipe", recipe])
    plain = parse(["--policy", "end-to-end", "--recipe", recipe])
    clock = plain.inputs
    expected = Inputs(terms=DEPLOYABLE_TERMS, history=10, clock=clock.clock, clock_at_rest=clock.clock_at_rest)
    assert (config.inputs, config.ppo.hold) == (expected, 2)
    assert_on_randomised_hardware(config.mixture)
    assert training_command(config).count("--observations deployable") == 1
    assert parse(training_command(config).split()[3:]) == config


def test_the_shares_of_scenarios_that_differ_only_in_hardware_are_added():
    mixture = hardware_mixture((("flat", 1.0), ("push:3+hardware", 2.0), ("flat+randomised", 0.5)))
    assert mixture == (("flat+randomised+hardware", 1.5), ("push:3+randomised+hardware", 2.0))


def test_the_command_of_a_distillation_repeats_it():
    config = distil.parse([*STUDENT, "--inputs.history", "4", "--labels", "100"])
    words = distillation_command(config).split()[3:]
    assert "--inputs.terms" not in words
    assert distil.parse(words) == config


def test_a_teacher_for_robots_has_the_servo_gains_of_the_maker():
    go1 = get_robot("go1")
    config = distil.parse([*STUDENT, "--robot", "go1"])
    assert make_teacher(config).robot.has_gains(go1.gains)
    assert make_teacher(config, on_hardware_profile=True).robot.has_gains(go1.gains)
    assert not make_teacher(replace(config, observations="all")).robot.has_gains(go1.gains)


def test_the_teacher_observes_the_true_state_and_the_student_its_terms(student):
    """The robots start at rest; the sensors of the profile are late, and have noise and encoder offsets."""
    config = distil.parse([*STUDENT, *SMALL_STUDENT])
    robots = make_robots(config, make_teacher(config).robot)
    shown = []
    group = PrivilegedTeacher(config, robots)
    policy = group._groups[0][0]
    policy._act = lambda seen, act=policy._act: shown.append(seen.copy()) or act(seen)
    observation, _ = robots.reset(seed=[1, 2])
    group.reset()
    features = load(student).features
    features.reset(2)
    home = np.tile(SIMPLE_QUAD.home_pose, (2, 1)).astype(np.float32)
    for step in range(12):
        inputs = features.update(observation, home)
        group.act(features.clock_phase, features.clock_frequency)
        np.testing.assert_array_equal(shown[-1], robots.true_observation())
        newest = {
            term.name: inputs[:, term.columns[1] - term.width : term.columns[1]] for term in features.terms.layout
        }
        for name in DEPLOYABLE_TERMS:
            columns = OBSERVATION[name]
            np.testing.assert_allclose(
                newest[name], observation[:, columns] * observation_table(SIMPLE_QUAD).scale[columns]
            )
        assert np.abs(shown[-1] - observation)[:, OBSERVATION["joint_position"]].max() > 1e-4
        observation, *_ = robots.step(home + 0.1 * np.sin(step, dtype=np.float32))
    robots.close()


def test_a_teacher_can_leave_the_position_error_uncorrected():
    """A student without this input could not predict the correction."""
    config = distil.parse(["--teacher", "mpc_wbc", "--observations", "deployable", "--position-error", "off"])
    for on_hardware_profile in (False, True):
        off, none = (
            make_teacher(each, on_hardware_profile) for each in (config, replace(config, position_error="none"))
        )
        assert none.parameters.position_gain > 0.0
        assert off.parameters == replace(none.parameters, position_gain=0.0)
        assert off.robot.has_gains(none.robot.gains)


@pytest.mark.parametrize("clock", ["constant", "none"])
def test_the_teacher_steps_by_the_constant_clock_of_the_student(clock):
    config = distil.parse(["--teacher", "mpc_wbc", "--observations", "deployable", "--clock", clock])
    teacher = make_teacher(config)
    inputs = student_inputs(config, teacher)
    assert inputs == replace(config.inputs, clock=teacher.frequency if clock == "constant" else 0.0)
    assert (inputs.clock_gain, inputs.position_error) == (0.0, 0.0)


def test_the_bundle_of_a_student_has_no_linear_velocity_and_folds_the_normalisation(student):
    policy, other = load(student), load(student)
    description = json.loads((student / "best" / "policy.json").read_bytes())
    assert "linear_velocity" not in [term["name"] for term in description["network_inputs"]["terms"]]
    assert description["training"]["observations"] == "deployable"
    policy.reset(2), other.reset(2)
    for seen in np.random.default_rng(0).normal(size=(6, 2, OBSERVATION_SIZE)).astype(np.float32):
        changed = seen.copy()
        changed[:, OBSERVATION["linear_velocity"]] += 3.0
        assert policy.act(seen).tobytes() == other.act(changed).tobytes()


def test_the_inputs_of_the_collection_have_the_period_of_the_policy(tmp_path):
    config = distil.parse([*STUDENT, *SMALL_STUDENT, "--hold", "3", "--out", str(tmp_path / "run")])
    with Interrupt() as interrupt:
        run = Distillation(config, interrupt)
    run._robots.close()
    assert run._collector._features.terms.period == run._policy().features.terms.period == pytest.approx(0.03)


def test_a_policy_for_robots_is_evaluated_on_the_hardware_profile(student):
    config = distil.parse(["--resume", "--out", str(student)])
    assert distillation_evaluation(config).startswith("python -m evaluate --hardware --policies trot ")
    assert evaluation_command(parse(PPO)).count("--hardware") == 1
    assert "--hardware" not in evaluation_command(parse(PPO[:2]))
    assert "the last 10 values at 50 Hz of angular velocity, " in describe_inputs(load_trained_run(student))


def test_a_stopped_student_has_the_same_settings(student):
    config = distil.parse([*STUDENT, *SMALL_STUDENT, "--out", str(student)])
    resumed = distil.parse(["--resume", "--out", str(student)])
    assert replace(resumed, out=config.out, resume=False, threads=1) == config


def ppo_model(*words):
    config = parse([*PPO, *SMALL_PPO, *words])
    env = make_env(config)
    return make_ppo(config, env), env


@pytest.mark.parametrize("symmetry", ["none", "actor", "actor-critic"])
def test_the_value_network_observes_the_true_state_and_the_policy_network_does_not(symmetry):
    model, env = ppo_model("--ppo.symmetry", symmetry)
    for parameter in model.policy.action_net.parameters():
        torch.nn.init.normal_(parameter)
    env.reset()
    env.step_async(np.full((4, 12), 0.3, np.float32))
    seen, *_ = env.step_wait()
    robots = env.env.unwrapped
    width = env.observation_space.shape[0] - env.privileged
    start = width + len(robots.batches)
    scale = observation_table(SIMPLE_QUAD).scale
    np.testing.assert_allclose(seen[:, start : start + OBSERVATION_SIZE], robots.true_observation() * scale, atol=1e-6)
    velocity = OBSERVATION["linear_velocity"]
    changed = seen.copy()
    changed[:, start + velocity.start : start + velocity.stop] += 1.0
    with torch.inference_mode():
        before, after = (torch.from_numpy(each) for each in (seen, changed))
        assert torch.equal(*(model.policy.get_distribution(each).distribution.mean for each in (before, after)))
        assert (model.policy.predict_values(before) != model.policy.predict_values(after)).all()


def test_the_mirror_of_the_value_network_covers_the_true_state():
    model, env = ppo_model("--ppo.symmetry", "actor-critic")
    seen = torch.from_numpy(env.reset())
    mirror, _ = model.policy.mirrors
    assert sorted(mirror.order.tolist()) == list(range(seen.shape[1]))
    image = torch.from_numpy(mirror(seen.numpy()))
    with torch.inference_mode():
        torch.testing.assert_close(model.policy.predict_values(seen), model.policy.predict_values(image))


def test_ppo_trains_a_policy_for_robots_alone(tmp_path):
    assert main([*PPO, *SMALL_PPO, "--out", str(tmp_path / "run")]) == 0
    policy = policies.load(tmp_path / "run")
    assert observations_of(policy.features.inputs) == "deployable"
    assert policy.hold == 2


def test_ppo_improves_a_student_on_its_observations(student, tmp_path):
    words = ["--policy", "end-to-end", "--recipe", "improve", "--start", str(student)]
    config = parse(words)
    assert (config.observations, config.ppo.hold) == ("deployable", 2)
    assert config.inputs == load(student).features.inputs
    assert_on_randomised_hardware(config.mixture)
    small = " ".join(SMALL_PPO).replace("--ppo.actor 8 ", "").split()
    assert main([*words, *small, "--out", str(tmp_path / "next")]) == 0
    assert policies.load(tmp_path / "next").features.inputs == config.inputs
    again = [*words[:-1], str(tmp_path / "next"), *small, "--mixture", "flat+hardware", "1"]
    assert main([*again, "--out", str(tmp_path / "third")]) == 0


def test_estimated_observations_are_the_deployable_ones_and_the_linear_velocity():
    config = distil.parse(["--teacher", "trot", "--observations", "estimated"])
    assert config.inputs.terms == (*DEPLOYABLE_TERMS, "linear_velocity")
    assert replace(config, observations="deployable", inputs=distil.parse(STUDENT).inputs) == distil.parse(STUDENT)


@pytest.mark.parametrize(
    ("words", "message"),
    [
        ("--observations deployable", "--observations: deployable needs --policy end-to-end, got residual"),
        ("--policy end-to-end --observations deploy", "--observations"),
        (
            "--policy end-to-end --observations deployable --inputs.terms command linear_velocity",
            "--inputs.terms: deployable observations have no linear_velocity",
        ),
        ("--policy end-to-end --observations deployable --inputs.terms mass", "--inputs.terms"),
        ("--policy end-to-end --observations deployable --inputs.lags 0.02", "Inputs.lags: must be empty"),
        ("--policy end-to-end --inputs.history 3", "Inputs.history: history needs Inputs.terms, got 3"),
        ("--policy end-to-end --observations deployable --sighted", "--sighted: --inputs.terms have no height scan"),
        (
            "--base stand --inputs.lags --inputs.averages --inputs.terms command",
            "--inputs.terms: terms need --policy end-to-end, got residual",
        ),
        ("--teacher trot --observations deployable --clock teacher", "--clock: the teacher's clock needs"),
        (
            "--teacher trot --observations deployable --position-error teacher",
            "--position-error: --inputs.terms have no",
        ),
        ("--teacher trot --observations deployable --inputs.averages 1", "Inputs.averages: must be empty"),
        (
            "--teacher trot --observations deployable --sighted",
            "--sighted: deployable observations have no height scan",
        ),
        ("--teacher trot --observations none", "--observations"),
        ("--teacher trot --observations deployable --inputs.history 0", "from 1 to 100"),
    ],
)
def test_a_wrong_combination_gets_one_line(words, message, capsys, tmp_path):
    assert main([*words.split(), "--out", str(tmp_path / "new")]) == 2
    error = capsys.readouterr().err
    assert message in error
    assert error.count("\n") == 1
    assert not (tmp_path / "new").exists()


def test_a_start_with_the_whole_observation_is_refused(tmp_path, capsys):
    words = ["--policy", "end-to-end", *SMALL_PPO]
    words[words.index("--mixture") + 1] = "flat"
    assert main([*words, "--out", str(tmp_path / "first")]) == 0
    capsys.readouterr()
    assert main([*PPO, *SMALL_PPO, "--start", str(tmp_path / "first"), "--out", str(tmp_path / "next")]) == 2
    assert "--observations: deployable needs --inputs.terms, got the whole observation" in capsys.readouterr().err
