"""A run that is stopped at any step and resumed equals the uninterrupted run to the bit:
weights, validations, bundles.
"""

import contextlib
import dataclasses
import itertools
import json
import os
import random
import shutil
import signal
from functools import partial
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
import torch
from gymnasium.error import ResetNeeded

import policies
from policies.network import Network
from policies.parameters import ParameterFile
from quad_env.physics.footsteps import FootContactTracker
from tests.seams import replace_validation
from train import run as training_run
from train.__main__ import main
from train.curriculum import CommandIntervalTracker
from train.run_folder import CHECKPOINTS, METRICS_FILE, VALIDATIONS_FILE, steps_done
from train.sb3 import callbacks, checkpoint
from train.sb3.vec_env import TrainingVecEnv

OPTIONS = (
    "--threads 1 --max-episode-steps 14 --mixture flat 0.5 push=100 0.25 rough 0.25 --validation.interval 200 "
    "--ppo.hold 1 --ppo.envs 16 --ppo.rollout-steps 8 --ppo.minibatch 64 --ppo.epochs 2 --ppo.actor 8 --ppo.critic 8 "
    "--ppo.learning-rate-schedule adaptive --ppo.target-kl 1e-3 --ppo.log-std-final -3 --steps 640 "
    "--ppo.learning-rate 1e-3 "
    "--curriculum 0.4 --rewards.foot-air-time 1 --effort-ramp 1 "
    "--ppo.cloning 0.3 --ppo.cloning-steps 400 --ppo.cloning-final 0.1"
)
ROLLOUT, SEGMENT, RUN = 8, 16, 40
"""Number of steps of each of the 16 robots."""


def bits(folder: Path) -> dict[str, bytes]:
    """Return the content of a run's folder by file, without times and logs, which depend on interruptions."""
    found = {str(path.relative_to(folder)): path.read_bytes() for path in folder.rglob("*.safetensors")}
    found[VALIDATIONS_FILE] = (folder / VALIDATIONS_FILE).read_bytes()
    for path in (folder / CHECKPOINTS).glob("*.json"):
        record = json.loads(path.read_bytes())
        del record["remembered"]["seconds"], record["remembered"]["cpu_seconds"]
        found[path.name] = json.dumps(record).encode()
    metrics = [json.loads(line) for line in (folder / METRICS_FILE).read_bytes().splitlines()]
    for figures in metrics:
        del figures["time/seconds"]
    found[METRICS_FILE] = json.dumps(metrics).encode()
    return found


class Killed(BaseException):
    """Exception that the product never catches."""


def of_weights(policy, *_):
    """Return an instant validation; the error grows with the distance of a policy from its base."""
    network: Network = policy.network
    error = float(np.abs(network.weights[-1]).sum())
    means = {"success_rate": 0.5, "velocity_error": error, "yaw_rate_error": 0.0, "fall_rate": 0.0}
    return {"flat": means | {"energy": 1.0, "cost_of_transport": float("nan")}}


def every_step_an_interval(_, __, velocity, ___):
    """Return command intervals of one step; regular intervals do not end within the four seconds of the runs."""
    return np.ones(len(velocity), bool), velocity[:, 1] > 0.0


def quicken(monkeypatch):
    replace_validation(monkeypatch, of_weights)
    monkeypatch.setattr(callbacks, "write_curve", lambda *_: None)
    monkeypatch.setattr(CommandIntervalTracker, "step", every_step_an_interval)


@pytest.fixture(autouse=True)
def quick(monkeypatch):
    quicken(monkeypatch)


@pytest.fixture(scope="module")
def runs(tmp_path_factory):
    """Return the folder with an uninterrupted run, `whole`, and one that was killed in its third segment, `killed`."""
    folder = tmp_path_factory.mktemp("runs")
    with pytest.MonkeyPatch.context() as patch:
        quicken(patch)
        begin(folder / "whole")
        killed_after(2 * SEGMENT + 3, partial(begin, folder / "killed"))
    return folder


@pytest.fixture
def killed(runs, tmp_path):
    """Return a copy of the killed run."""
    return Path(shutil.copytree(runs / "killed", tmp_path / "killed"))


def begin(folder):
    assert main([*OPTIONS.split(), "--out", str(folder)]) == 0


def resume(folder):
    # Another process has different random states.
    random.seed(5)
    np.random.seed(5)  # noqa: NPY002
    torch.manual_seed(5)
    assert main(["--resume", "--threads", "1", "--out", str(folder)]) == 0


@contextlib.contextmanager
def after(steps, what):
    """Call `what` after `steps` steps of each robot."""
    step_wait, taken = TrainingVecEnv.step_wait, itertools.count()

    def stepping(env):
        if next(taken) == steps:
            what()
        return step_wait(env)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(TrainingVecEnv, "step_wait", stepping)
        yield


def killed_after(steps, go_on):
    def die():
        raise Killed

    with after(steps, die), pytest.raises(Killed):
        go_on()


def interrupted_after(steps, words):
    """Press Ctrl-C in the last of `steps` steps of each robot."""
    with after(steps - 1, partial(os.kill, os.getpid(), signal.SIGINT)):
        assert main(words) == 130


@pytest.mark.parametrize("steps", [0, 16, 28])
def test_a_run_that_is_stopped_anywhere_ends_with_the_same_bits(steps, runs, tmp_path):
    killed_after(steps, partial(begin, tmp_path / "run"))
    resume(tmp_path / "run")
    assert bits(tmp_path / "run") == bits(runs / "whole")


WALKER = (
    "--policy end-to-end --recipe joystick --threads 1 --max-episode-steps 14 --validation.interval 200 --kicks 1 "
    "--ppo.hold 1 --ppo.envs 16 --ppo.rollout-steps 8 --ppo.minibatch 64 --ppo.epochs 2 --ppo.actor 8 --ppo.critic 8 "
    "--steps 640"
)


def test_a_run_with_running_statistics_and_random_clocks_ends_with_the_same_bits(tmp_path):
    for name in ("whole", "run"):
        words = [*WALKER.split(), "--out", str(tmp_path / name)]
        if name == "whole":
            assert main(words) == 0
        else:
            interrupted_after(20, words)
    count = checkpoint.load(tmp_path / "run" / CHECKPOINTS).tensors["policy.features_extractor.count"]
    assert count == 2 * 3 * ROLLOUT * 16, "of three rollouts and their mirror images"
    resume(tmp_path / "run")
    assert bits(tmp_path / "run") == bits(tmp_path / "whole")


@pytest.mark.parametrize(
    ("module", "name", "done"),
    [(callbacks, "save_bundle", True), (checkpoint, "save", False), (checkpoint, "save", True)],
)
def test_a_run_that_is_stopped_between_its_final_files_ends_with_the_same_bits(
    module, name, done, runs, killed, monkeypatch
):
    """A run resumed from its last checkpoint has no training step left that would write the other final files."""

    def dying(*arguments):
        written.append(arguments)
        if done or len(written) < 2:
            write(*arguments)
        if len(written) == 2:  # the first files belong to the checkpoint from which the run resumes
            raise Killed

    write, written = getattr(module, name), []
    with monkeypatch.context() as patch:
        patch.setattr(module, name, dying)
        with pytest.raises(Killed):
            resume(killed)
    if not (done and module is checkpoint):
        resume(killed)
    assert bits(killed) == bits(runs / "whole")


@pytest.mark.parametrize("steps", [9, 20])  # at the end of a segment; within the second segment
def test_ctrl_c_keeps_every_rollout_that_is_complete_and_the_run_ends_with_the_same_bits(steps, runs, tmp_path, capsys):
    folder = tmp_path / "run"
    interrupted_after(steps, [*OPTIONS.split(), "--out", str(folder)])
    done = -(-steps // ROLLOUT) * ROLLOUT * 16
    assert (
        f"--out {folder}; {done:,} steps are kept; the policy until now is {folder / 'last'}" in capsys.readouterr().err
    )
    assert steps_done(folder) == done
    assert policies.load(folder / "last").network
    resume(folder)
    assert f"continuing at {done:,} steps" in capsys.readouterr().out
    assert bits(folder) == bits(runs / "whole")


def test_a_run_that_is_killed_in_its_first_segment_keeps_its_early_checkpoint(runs, tmp_path, monkeypatch, capsys):
    monkeypatch.setattr(callbacks, "FIRST_CHECKPOINT_DEADLINE", 0.0)
    folder = tmp_path / "run"
    killed_after(SEGMENT - 1, partial(begin, folder))
    assert steps_done(folder) == ROLLOUT * 16
    assert policies.load(folder / "last").network.weights[-1].any()
    resume(folder)
    assert f"continuing at {ROLLOUT * 16:,} steps" in capsys.readouterr().out
    assert bits(folder) == bits(runs / "whole")


@pytest.mark.parametrize(("seconds", "checkpoints"), [(16.0, [0, 128, 256]), (14.0, [0, 256]), (40.0, [0, 128, 256])])
def test_the_first_checkpoint_comes_within_30_s_of_work_and_the_others_between_segments(
    seconds, checkpoints, tmp_path, monkeypatch
):
    """A rollout lasts `seconds`, and a segment has two rollouts."""

    def stepping(env):
        clock.append(clock[-1] + seconds / ROLLOUT)
        return step_wait(env)

    kept, clock, save, step_wait = [], [0.0], checkpoint.save, TrainingVecEnv.step_wait
    monkeypatch.setattr(checkpoint, "save", lambda *of: (kept.append(of[1].progress["steps"]), save(*of)))
    monkeypatch.setattr(callbacks, "time", SimpleNamespace(monotonic=lambda: clock[-1], process_time=lambda: clock[-1]))
    monkeypatch.setattr(TrainingVecEnv, "step_wait", stepping)
    killed_after(2 * SEGMENT - 1, partial(begin, tmp_path / "run"))
    assert kept == checkpoints


def test_ctrl_c_before_the_first_rollout_leaves_the_base_as_a_policy_that_loads(runs, tmp_path, monkeypatch, capsys):
    folder = tmp_path / "run"

    def pressed(*args):
        os.kill(os.getpid(), signal.SIGINT)
        return make(*args)

    make = training_run.make_env
    with monkeypatch.context() as patch:
        patch.setattr(training_run, "make_env", pressed)
        assert main([*OPTIONS.split(), "--out", str(folder)]) == 130
    said = f"0 steps are kept; the policy until now is {folder / 'last'}, its base without a correction"
    assert said in capsys.readouterr().err
    assert not policies.load(folder / "last").network.weights[-1].any()
    begin(folder)  # a new start is possible
    assert bits(folder) == bits(runs / "whole")


def test_ctrl_c_again_and_again_loses_nothing(runs, tmp_path):
    folder = tmp_path / "run"
    interrupted_after(3, [*OPTIONS.split(), "--out", str(folder)])
    for steps in (2, ROLLOUT + 1, 1):  # in repeated steps; after them; at the start of a segment
        interrupted_after(steps, ["--resume", "--threads", "1", "--out", str(folder)])
    assert steps_done(folder) == 3 * ROLLOUT * 16
    resume(folder)
    assert bits(folder) == bits(runs / "whole")


def forget(**values):
    """Return a function that replaces values in the restored state of the callbacks."""

    def of(patch):
        def forgetful(folder):
            found = load(folder)
            found.progress["remembered"].update(values)
            return found

        load = checkpoint.load
        patch.setattr(checkpoint, "load", forgetful)

    return of


LEFT_OUT = {
    "weights": lambda patch: patch.setattr(torch.nn.Module, "load_state_dict", lambda *_: None),
    "optimiser": lambda patch: patch.setattr(checkpoint, "restore_optimiser", lambda *_: None),
    "torch's generator": lambda patch: patch.setattr(torch, "set_rng_state", lambda _: None),
    "NumPy's generator": lambda patch: patch.setattr(np.random, "set_state", lambda _: None),
    "adaptive rate": lambda patch: patch.setattr(callbacks.TrainingCallback, "_restore_rate", lambda _: None),
    "swings that end with their episode": lambda patch: patch.setattr(FootContactTracker, "reset", lambda *_: None),
    "new episodes": lambda patch: patch.setattr(callbacks.TrainingCallback, "_begin_segment", lambda _: None),
    "severities": forget(shares=[]),
    "weights of effort": lambda patch: patch.setattr(callbacks, "effort_weight_scale", lambda *_: 0.0),
    "validations": forget(validations=[]),
}


@pytest.mark.parametrize("what", LEFT_OUT)
def test_whatever_is_not_restored_shows(what, runs, killed, monkeypatch):
    LEFT_OUT[what](monkeypatch)
    with contextlib.suppress(ResetNeeded):  # robots of a new severity without a reset
        resume(killed)
    assert bits(killed) != bits(runs / "whole")


def test_a_bundle_has_the_base_of_the_start_whatever_is_searched_meanwhile(tmp_path, monkeypatch):
    """The search writes its parameters during the validation."""
    searched, at_the_start = ParameterFile.load_for_robot, policies.make("trot_reference", servo="own").parameters

    def judged(*_):
        searched_since = lambda *of: dataclasses.replace(searched(*of), frequency=1.5)  # noqa: E731
        monkeypatch.setattr(ParameterFile, "load_for_robot", searched_since)
        return of_weights(*_)

    replace_validation(monkeypatch, judged)
    begin(tmp_path / "run")
    assert policies.load(tmp_path / "run" / "last").base.parameters == at_the_start
