"""All steps for your own robot: `python -m train robot my_robot.xml`.

It describes the robot, checks that a model-predictive controller walks on it, distils this controller into a network
(the student), exports the network as ONNX, compares student, controller and a scripted trot on every axis of
disturbance, and writes the report. With `--learner residual`, it searches the parameters of a trot and trains a
residual policy instead.
Stages that are done are not repeated: after Ctrl-C, or when the computer was switched off, the same command continues.
"""

import json
import os
import shlex
import subprocess
import sys
import time
from collections.abc import Callable
from dataclasses import asdict, dataclass, replace
from functools import partial
from pathlib import Path
from typing import Annotated, Literal, NamedTuple

import tyro

from evaluate.hardware import parse_robot_option
from policies import bundle
from policies.parameters import limits_of, parameter
from policies.registry import STUDENT
from policies.shipped import models_folder
from quad_env.cli.child_process import available_cores
from quad_env.cli.command_line import UsageError, check_numbers
from quad_env.files.reading import read_bytes
from quad_env.files.writing import make_writable_folder, write_atomically
from train.commands import export
from train.config import BaseName
from train.run_folder import BEST, has_checkpoint, steps_done
from train.search import trot

RESIDUAL = "residual"
"""Name of the policy that the pipeline trains, and of its folder in the models folder of the robot."""
COMPARED = {STUDENT: (STUDENT, "trot_feedback"), RESIDUAL: ("trot", "trot_feedback", RESIDUAL)}
"""Learner, `student` or `residual` -> names of the policies that the pipeline compares by default.

A student is also compared with its teacher.
"""
LEARNER_OPTIONS = {STUDENT: ("teacher", "labels"), RESIDUAL: ("base", "steps")}
"""Learner, `student` or `residual` -> names of the pipeline's options that only this learner has."""
CHECK_FILE = "teacher.json"
"""Name of the JSON file in the output folder with the success rate of the teacher on flat ground.

The pipeline writes the file after the check that the teacher walks on the robot.
"""
OPTIONS_FILE = "begun.json"
"""Name of the JSON file in the output folder with the options of the first call of the pipeline.

Later calls with the same folder must have the same options."""
DESCRIPTION_FILE = "described.txt"
"""Name of the text file with the description of the robot that `python -m quad_env describe` prints."""
MUTABLE_OPTIONS = ("out", "threads")
"""Names of the options of the pipeline that may differ between two calls with the same output folder."""
SEARCH = trot.TrotSearchOptions(generations=12, steps=400, check_episodes=48)
"""Options of the search of trot parameters.

A short search is enough, because most robots already walk with the start parameters, which are scaled from SimpleQuad.
"""


@dataclass(frozen=True)
class RobotPipelineOptions:
    """Describe, check, distil, export, compare, report: some 20 minutes on two cores."""

    robot: Annotated[str, tyro.conf.Positional]
    """MJCF or URDF of the robot, a TOML that `python -m quad_env describe` has written, or a name like go1."""
    learner: Literal["student", "residual"] = "student"
    """student: a network learns the actions of a teacher and then runs alone. residual: the parameters of a trot
    are searched, and a network learns by PPO to correct it."""
    teacher: str = "mpc_wbc"
    """Policy that the student learns from: a name, a bundle, or a file of another project."""
    labels: int = parameter(1_000_000, limits=(1, 10**12 - 1))
    """Number of actions of the teacher that the student learns from."""
    base: BaseName = "trot_feedback"
    """Policy that the residual corrects."""
    steps: int = parameter(4_000_000, limits=(1, 10**12 - 1))
    """Number of learner steps of the residual's training, summed over all robots."""
    training: tuple[str, ...] = ()
    """Further options of `python -m train`, in quotes: "--envs 512" or, for a residual, "--ppo.envs 512"."""
    policies: tuple[str, ...] = ()
    """Names of the policies that are compared after the training; by default teacher, student and
    trot_feedback, or trot, trot_feedback and residual."""
    scenarios: tuple[str, ...] = ("default",)
    """Names of the scenarios on which the policies are compared."""
    episodes: int = parameter(8, limits=(1, 1_000_000))
    """Number of episodes of each policy on each scenario."""
    seed: int = parameter(0, limits=(0, 2**31))
    """Seed of the search, of the training, and of the episodes of the evaluation."""
    out: Path | None = None
    """Folder for all files of the pipeline; results/ROBOT by default."""
    threads: int = parameter(available_cores(), limits=(1, 256))
    """Number of threads of the simulation; by default the number of cores of the machine."""

    @property
    def folder(self) -> Path:
        """Folder of all files of the pipeline: `out`, or the default folder if `out` is None."""
        return self.out if self.out is not None else Path("results") / Path(self.robot).stem

    @property
    def compared(self) -> tuple[str, ...]:
        """Names of the policies that are compared after the training: `policies`, or the default of the learner."""
        if self.policies:
            return self.policies
        defaults = COMPARED[self.learner]
        return (self.teacher, *defaults) if self.learner == STUDENT and self.teacher not in defaults else defaults

    @property
    def onnx(self) -> Path:
        """ONNX file with the student, a file in `folder`."""
        return self.folder / f"{STUDENT}.onnx"

    @property
    def evaluation_folder(self) -> Path:
        """Folder of the results of the evaluation, a subfolder of `folder`."""
        return self.folder / "evaluation"

    @property
    def toml(self) -> Path:
        """TOML file with the description of the robot. A user may edit the file before the search."""
        given = Path(self.robot)
        return given if given.suffix == ".toml" else self.folder / f"{given.stem}.toml"


OLD_OPTIONS = {"learner": RESIDUAL, **{name: getattr(RobotPipelineOptions, name) for name in LEARNER_OPTIONS[STUDENT]}}
"""Name of an option -> value that the pipeline assumes if an older version has written `OPTIONS_FILE` without it."""


class Stage(NamedTuple):
    """Stage of the pipeline for a new robot, for example the description of the robot."""

    name: str
    """Name of the stage in the printed progress, for example "train a residual"."""
    minutes: float
    """Typical duration of the stage on two cores, min."""
    is_done: Callable[[], bool]
    """Function without arguments that returns True if the results of the stage already exist."""
    action: Callable[[], object]
    """Function without arguments that performs the stage."""


def main(options: RobotPipelineOptions) -> int:
    """Run all stages of the pipeline that are not done yet, and return the exit code.

    Args:
        options: Options of the command. UsageError is raised if an option is not valid.

    Returns:
        The exit code, 0.

    Raises:
        KeyboardInterrupt: After Ctrl-C. The message has the command line that continues the pipeline.
    """
    check_numbers(options, limits_of(options))
    _check_learner_options(options)
    if not Path(options.robot).suffix:
        parse_robot_option(options.robot)
    make_writable_folder(options.folder)
    _check_same_options(options)
    stages = _stages(options)
    try:
        for index, stage in enumerate(stages):
            head = f"[{index + 1} of {len(stages)}] {stage.name}"
            if stage.is_done():
                print(f"{head}: done already", flush=True)
                continue
            remaining = sum(later.minutes for later in stages[index:] if not later.is_done())
            print(f"{head}; about {remaining:.0f} min left", flush=True)
            began = time.monotonic()
            stage.action()
            print(f"{head}: {(time.monotonic() - began) / 60.0:.1f} min", flush=True)
    except KeyboardInterrupt as interrupt:
        again = f"continue with: python -m train robot {shlex.join(sys.argv[2:])}"
        raise KeyboardInterrupt("; ".join([*map(str, interrupt.args), again])) from None
    if options.learner == STUDENT:
        print(f"network: {options.onnx}")
    print(f"report: {options.evaluation_folder / 'report.html'}")
    return 0


def _check_learner_options(options: RobotPipelineOptions) -> None:
    """Raise UsageError if an option was given that only the other learner (student or residual) has."""
    other = RESIDUAL if options.learner == STUDENT else STUDENT
    default = RobotPipelineOptions(robot=options.robot)
    for name in LEARNER_OPTIONS[other]:
        if getattr(options, name) != getattr(default, name):
            raise UsageError(f"--{name} is an option of --learner {other}, not of {options.learner}")


def _stages(options: RobotPipelineOptions) -> list[Stage]:
    """Return the stages of the pipeline in their order."""
    is_described = (options.folder / DESCRIPTION_FILE).is_file
    is_trained = partial(_has_model, options, f"{options.learner}/{bundle.DESCRIPTION}")
    describe = Stage("describe the robot", 0.1, is_described, partial(_describe, options))
    compare = Stage("compare them", 5.0, partial(_is_compared, options), partial(_compare, options))
    if options.learner == RESIDUAL:
        is_searched = partial(_has_model, options, trot.ACCOUNT)
        search = Stage("search its trot", 4.0, is_searched, partial(_search, options))
        return [describe, search, Stage("train a residual", 9.0, is_trained, partial(_train, options)), compare]
    is_checked = (options.folder / CHECK_FILE).is_file
    return [
        describe,
        Stage(f"check that {options.teacher} walks", 0.3, is_checked, partial(_check_teacher, options)),
        Stage(f"distil {options.teacher} into a network", 12.0, is_trained, partial(_distil, options)),
        Stage("export the network", 0.1, options.onnx.is_file, partial(_export, options)),
        compare,
    ]


def _model_path(options: RobotPipelineOptions, name: str) -> Path:
    """Return the path of the file or folder `name` in the models folder of the robot."""
    return models_folder(parse_robot_option(str(options.toml)).robot_model) / name


def _has_model(options: RobotPipelineOptions, name: str) -> bool:
    """Return True if the models folder of the robot has a file with the path `name`."""
    return options.toml.is_file() and _model_path(options, name).is_file()


def _check_teacher(options: RobotPipelineOptions) -> None:
    """Check that the teacher walks on the robot; raise UsageError with the likely reason if it does not."""
    from train.teacher_check import EPISODES, check_walking

    hardware = parse_robot_option(str(options.toml))
    success = check_walking(options.teacher, hardware, options.threads)
    print(
        f"{options.teacher} succeeds in {round(success * EPISODES)} of {EPISODES} episodes on flat ground", flush=True
    )
    write_atomically(options.folder / CHECK_FILE, (json.dumps({"success_rate": success}) + "\n").encode())


def _distil(options: RobotPipelineOptions) -> None:
    """Distil the teacher, or continue a distillation, and copy the best bundle to the robot's models folder."""
    from train.commands import distil
    from train.distillation.run import is_finished

    folder = options.folder / "distillation"
    if not is_finished(folder):
        words = ["--teacher", options.teacher, "--labels", str(options.labels)]
        distil.run([*words, *_shared_words(options, folder)])
    bundle.copy(folder / BEST, _model_path(options, STUDENT))


def _export(options: RobotPipelineOptions) -> None:
    """Export the student as an ONNX file."""
    student = _model_path(options, STUDENT)
    export.main(export.ExportOptions(folder=student, robot=str(options.toml), out=options.onnx))


def _search(options: RobotPipelineOptions) -> None:
    """Search the parameters of the robot's open-loop trot by CMA-ES; write them to the robot's models folder."""
    trot.main(replace(SEARCH, robot=str(options.toml), seed=options.seed, threads=options.threads))


def _train(options: RobotPipelineOptions) -> None:
    """Train a residual policy, or continue its training, and copy the best bundle to the robot's models folder."""
    # This import is not at the top of the module, because it would be circular there.
    from train.commands.run import run

    folder = options.folder / "training"
    if steps_done(folder) < options.steps:
        steps = str(options.steps)
        words = ["--base", options.base, "--steps", steps, "--validation.interval", steps]
        run([*words, *_shared_words(options, folder)])
    bundle.copy(folder / BEST, _model_path(options, RESIDUAL))


def _shared_words(options: RobotPipelineOptions, folder: Path) -> list[str]:
    """Return the words of a command line that every kind of training has in this pipeline.

    Args:
        options: Options of the pipeline.
        folder: Run folder of the training. If it has a checkpoint, the words continue the run.

    Returns:
        Robot, seed, threads and run folder, and the further options that the user gave for the training.
    """
    resume = ["--resume"] if has_checkpoint(folder) else []
    run_words = f"--seed {options.seed} --threads {options.threads}".split()
    further = [word for entry in options.training for word in shlex.split(entry)]
    return ["--robot", str(options.toml), "--out", str(folder), *run_words, *resume, *further]


def _compare(options: RobotPipelineOptions) -> None:
    """Evaluate and compare the policies of the pipeline, or continue an interrupted evaluation."""
    from evaluate.commands.execution import execute
    from evaluate.commands.options import EvaluateOptions
    from evaluate.commands.plan import check, load_run_options
    from evaluate.records.store import is_unfinished

    folder = options.evaluation_folder
    if is_unfinished(folder):
        execute(check(replace(load_run_options(folder), resume=True)))
        return
    shared = {name: getattr(options, name) for name in ("scenarios", "episodes", "seed", "threads")}
    execute(check(EvaluateOptions(robot=str(options.toml), policies=options.compared, out=folder, **shared)))


def _is_compared(options: RobotPipelineOptions) -> bool:
    """Return True if the evaluation folder has the results of a finished evaluation."""
    from evaluate.records.store import is_unfinished

    folder = options.evaluation_folder
    return (folder / "results.json").is_file() and not is_unfinished(folder)


def _check_same_options(options: RobotPipelineOptions) -> None:
    """Check that every call of the pipeline for one output folder has the same options.

    The first call writes its options to the folder. Raises UsageError if a later call has other options.
    """
    robot = str(Path(options.robot).resolve()) if Path(options.robot).suffix else options.robot
    absolute = asdict(replace(options, robot=robot, policies=options.compared))
    fixed = {name: value for name, value in absolute.items() if name not in MUTABLE_OPTIONS}
    current = json.loads(json.dumps(fixed))
    file = options.folder / OPTIONS_FILE
    if not file.is_file():
        write_atomically(file, (json.dumps(current, indent=2) + "\n").encode())
        return
    try:
        started_with = OLD_OPTIONS | json.loads(read_bytes(file))
        changed = [name for name in current if started_with.get(name) != current[name]]
    except (ValueError, AttributeError):
        changed = ["unreadable"]
    if changed:
        names = ", ".join(changed)
        raise UsageError(f"{options.folder} was started with other options ({names}): choose another --out")


def _describe(options: RobotPipelineOptions) -> None:
    """Print the description of the robot, and write it, a TOML file and a picture to the output folder.

    The text is printed by `python -m quad_env describe`. Raises UsageError if the robot cannot be used.
    """
    command = [sys.executable, "-m", "quad_env", "describe", options.robot]
    inferred = options.folder / "inferred.toml"
    has_toml = options.toml.is_file()
    if inferred.is_file():
        raise UsageError(f"{inferred} has gaps to fill: give it instead of {options.robot}, or remove it")
    toml_words = [] if has_toml else ["--toml", str(inferred)]
    utf8 = os.environ | {"PYTHONIOENCODING": "utf-8"}
    done = subprocess.run([*command, *toml_words], stdout=subprocess.PIPE, encoding="utf-8", env=utf8)
    print(done.stdout, end="")
    if done.returncode:
        remedy = f"; fill the gaps in {inferred}, and give that instead" if inferred.is_file() else ""
        raise UsageError(f"{options.robot} cannot be used as it is{remedy}")
    if not has_toml:
        inferred.rename(options.toml)
    if subprocess.run([*command, "--picture", str(options.folder / "standing.png")], capture_output=True).returncode:
        print("no picture of the robot: rendering is impossible here", file=sys.stderr)
    write_atomically(options.folder / DESCRIPTION_FILE, done.stdout.encode())
