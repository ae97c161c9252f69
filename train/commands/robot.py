"""All steps for your own robot: `python -m train robot my_robot.xml`.

It describes the robot, searches its trot, trains a residual, compares them on every axis of disturbance and writes the
report. Stages that are done are not repeated: after Ctrl-C, or when the computer was switched off, the same command
continues.
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
from typing import Annotated, NamedTuple

import tyro

from evaluate.hardware import parse_robot_option
from policies import bundle
from policies.parameters import limits_of, parameter
from policies.shipped import folder_of
from quad_env.cli.child_process import available_cores
from quad_env.cli.command_line import UsageError, check_numbers
from quad_env.files.reading import read_bytes
from quad_env.files.writing import make_writable_folder, write_atomically
from train.config import BaseName
from train.run_folder import BEST, has_checkpoint, steps_done
from train.search import trot

RESIDUAL, OPTIONS_FILE, DESCRIPTION_FILE = "residual", "begun.json", "described.txt"
MUTABLE_OPTIONS = "out", "threads"
"""Options that may change from one call to the next."""
SEARCH = trot.TrotSearchOptions(generations=12, steps=400, check_episodes=48)
"""A short search: SimpleQuad's parameters walk on most robots already."""


@dataclass(frozen=True)
class RobotPipelineOptions:
    """Describe, search, train, evaluate, report: some 20 minutes on two cores."""

    robot: Annotated[str, tyro.conf.Positional]
    """MJCF or URDF of the robot, a TOML that `python -m quad_env describe` has written, or a name such as go1."""
    base: BaseName = "trot_feedback"
    """Policy that the residual corrects."""
    steps: int = parameter(4_000_000, limits=(1, 10**12 - 1))
    """Steps of the training."""
    training: tuple[str, ...] = ()
    """Further options of `python -m train`, in quotes, such as "--ppo.envs 512"."""
    policies: tuple[str, ...] = ("trot", "trot_feedback", RESIDUAL)
    """Policies compared in the end, by name."""
    scenarios: tuple[str, ...] = ("default",)
    """Scenarios that they are compared on."""
    episodes: int = parameter(8, limits=(1, 1_000_000))
    """Episodes of each policy on each scenario."""
    seed: int = parameter(0, limits=(0, 2**31))
    """Seed of search and training, and of the evaluation's episodes."""
    out: Path | None = None
    """Folder for everything; results/ROBOT when not given."""
    threads: int = parameter(available_cores(), limits=(1, 256))
    """Threads of the simulation (count; default: this machine's cores)."""

    @property
    def folder(self) -> Path:
        """Folder for everything."""
        return self.out if self.out is not None else Path("results") / Path(self.robot).stem

    @property
    def toml(self) -> Path:
        """File of the robot, which may be edited before the search."""
        given = Path(self.robot)
        return given if given.suffix == ".toml" else self.folder / f"{given.stem}.toml"


class Stage(NamedTuple):
    """A stage of the pipeline, with its usual time on two cores, min."""

    name: str
    minutes: float
    done: Callable[[], bool]
    action: Callable[[], object]


def main(options: RobotPipelineOptions) -> int:
    """Run the stages that are left; the exit code. Raises UsageError, and KeyboardInterrupt with the command that
    continues."""
    check_numbers(options, limits_of(options))
    if not Path(options.robot).suffix:
        parse_robot_option(options.robot)
    make_writable_folder(options.folder)
    _check_same_options(options)
    stages = _stages(options)
    try:
        for place, stage in enumerate(stages):
            head, done = f"[{place + 1} of {len(stages)}] {stage.name}", stage.done()
            left = sum(each.minutes for each in stages[place:] if not each.done())
            print(f"{head}: done already" if done else f"{head}; about {left:.0f} min left", flush=True)
            if not done:
                began = time.monotonic()
                stage.action()
                print(f"{head}: {(time.monotonic() - began) / 60.0:.1f} min", flush=True)
    except KeyboardInterrupt as interrupt:
        again = f"continue with: python -m train robot {shlex.join(sys.argv[2:])}"
        raise KeyboardInterrupt("; ".join([*map(str, interrupt.args), again])) from None
    print(f"report: {options.folder / 'evaluation' / 'report.html'}")
    return 0


def _stages(options: RobotPipelineOptions) -> list[Stage]:
    folder, toml = options.folder, str(options.toml)
    training, evaluation = folder / "training", folder / "evaluation"

    from evaluate.records.store import is_unfinished

    def own(name: str) -> Path:
        """A file among the robot's own."""
        return folder_of(parse_robot_option(toml).robot_model) / name

    def search() -> None:
        trot.main(replace(SEARCH, robot=toml, seed=options.seed, threads=options.threads))

    def train() -> None:
        from train.commands.run import run  # here, since it knows this command

        words = f"--base {options.base} --steps {options.steps} --validation.interval {options.steps}"
        words += f" --seed {options.seed} --threads {options.threads}" + " --resume" * has_checkpoint(training)
        more = [word for each in options.training for word in shlex.split(each)]
        if steps_done(training) < options.steps:
            run(["--robot", toml, "--out", str(training), *words.split(), *more])
        bundle.copy(training / BEST, own(RESIDUAL))

    def evaluate() -> None:
        from evaluate.commands.execution import execute
        from evaluate.commands.options import EvaluateOptions as Comparison
        from evaluate.commands.plan import check, load_run_options

        given = {name: getattr(options, name) for name in ("policies", "scenarios", "episodes", "seed", "threads")}
        plan = Comparison(robot=toml, out=evaluation, **given)
        execute(check(replace(load_run_options(evaluation), resume=True) if is_unfinished(evaluation) else plan))

    def compared() -> bool:
        return (evaluation / "results.json").is_file() and not is_unfinished(evaluation)

    def found(name: str) -> bool:
        return options.toml.is_file() and own(name).is_file()

    return [
        Stage("describe the robot", 0.1, (folder / DESCRIPTION_FILE).is_file, partial(_describe, options)),
        Stage("search its trot", 4.0, partial(found, trot.ACCOUNT), search),
        Stage("train a residual", 9.0, partial(found, f"{RESIDUAL}/{bundle.DESCRIPTION}"), train),
        Stage("compare them", 5.0, compared, evaluate),
    ]


def _check_same_options(options: RobotPipelineOptions) -> None:
    """Keep the options in the folder. Raises UsageError where they are others than those that it was started with."""
    robot = str(Path(options.robot).resolve()) if Path(options.robot).suffix else options.robot
    given = {
        name: value for name, value in asdict(replace(options, robot=robot)).items() if name not in MUTABLE_OPTIONS
    }
    now, begun = json.loads(json.dumps(given)), options.folder / OPTIONS_FILE
    if not begun.is_file():
        write_atomically(begun, (json.dumps(now, indent=2) + "\n").encode())
        return
    try:
        then = json.loads(read_bytes(begun))
        other = [name for name in now if then.get(name) != now[name]]
    except (ValueError, AttributeError):
        other = ["unreadable"]
    if other:
        raise UsageError(f"{options.folder} was started with other options ({', '.join(other)}): choose another --out")


def _describe(options: RobotPipelineOptions) -> None:
    """Print the description, and keep it with a TOML and a picture. Raises UsageError where the robot has errors."""
    command = [sys.executable, "-m", "quad_env", "describe", options.robot]
    written, given = options.folder / "inferred.toml", options.toml.is_file()
    if written.is_file():
        raise UsageError(f"{written} has gaps to fill: give it instead of {options.robot}, or remove it")
    words, utf8 = [] if given else ["--toml", str(written)], os.environ | {"PYTHONIOENCODING": "utf-8"}
    done = subprocess.run([*command, *words], stdout=subprocess.PIPE, encoding="utf-8", env=utf8)
    print(done.stdout, end="")
    if done.returncode:
        kept = f"; fill the gaps in {written}, and give that instead" if written.is_file() else ""
        raise UsageError(f"{options.robot} cannot be used as it is{kept}")
    if not given:
        written.rename(options.toml)
    if subprocess.run([*command, "--picture", str(options.folder / "standing.png")], capture_output=True).returncode:
        print("no picture of the robot: rendering is impossible here", file=sys.stderr)
    write_atomically(options.folder / DESCRIPTION_FILE, done.stdout.encode())
