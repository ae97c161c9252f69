"""A user's reward term, `my_file.py:FUNCTION=weight`, with the SHA-256 of its file, which must not change in a run."""

import contextlib
import functools
import hashlib
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

from policies.foreign import python_file
from policies.foreign.reference import Reference
from quad_env.cli.command_line import UsageError
from quad_env.config import RewardTerm, TaskConfig
from quad_env.files.reading import read_bytes
from quad_env.task.rewards import RewardTermError

OPTION = "--reward-terms"


@dataclass(frozen=True)
class FileTerm:
    """A function in a Python file, and its weight."""

    file: str
    function: str
    weight: float
    sha256: str
    """Of the file at the start of the run."""

    @classmethod
    def parse(cls, text: str) -> "FileTerm":
        """The term of a text, with the present SHA-256 of its file. Raises UsageError."""
        reference, _, number = text.rpartition("=")
        file, _, function = reference.rpartition(":")
        try:
            weight = float(number)
        except ValueError:
            weight = None
        if weight is None or not file.endswith(".py") or not function:
            how = "a file, a function in it and its weight, as in my_file.py:FUNCTION=-0.1"
            raise UsageError(f"{OPTION}: {text} must be {how}")  # a ValueError would be lost on its way through tyro
        with reported():
            return cls(file, function, weight, _digest(file))

    def __str__(self) -> str:
        return f"{self.file}:{self.function}={self.weight!r}"


def check(terms: Sequence[FileTerm]) -> None:
    """Raise UsageError unless each file is unchanged and its term gives a reward to two robots that stand."""
    if not terms:
        return
    # Only now, so that --help and mistakes answer at once: MuJoCo takes long to import.
    from quad_env.envs.vector_env import SimpleQuadVectorEnv

    with reported():
        for term in terms:
            _check_file(term)
        robots = SimpleQuadVectorEnv(2, nthread=1, config=TaskConfig(reward_terms=load(terms)))
        robots.reset(seed=0)
        robots.step([robots.robot.home_pose] * 2)  # type: ignore[arg-type]


def load(terms: Sequence[FileTerm]) -> tuple[RewardTerm, ...]:
    """The terms as the environment takes them. Raises UsageError."""
    try:
        return TaskConfig(reward_terms=tuple(map(_loaded, terms))).reward_terms
    except ValueError as error:
        raise UsageError(f"{OPTION}: {error}") from None


@contextlib.contextmanager
def reported() -> Iterator[None]:
    """Context in which a term that gives no reward is a UsageError."""
    try:
        yield
    except RewardTermError as error:
        raise UsageError(f"{OPTION}: {error}") from None


@functools.cache
def _loaded(term: FileTerm) -> RewardTerm:
    _check_file(term)
    return RewardTerm(term.function, python_file.found(Reference(Path(term.file), term.function)), term.weight)


def _check_file(term: FileTerm) -> None:
    if _digest(term.file) != term.sha256:
        raise RewardTermError(
            f"{term.file} has changed since the start of the run (SHA-256 differs): restore it, or start another run"
        )


def _digest(file: str) -> str:
    """SHA-256. Raises RewardTermError where there is no such file."""
    try:
        return hashlib.sha256(read_bytes(Path(file))).hexdigest()
    except OSError as error:
        raise RewardTermError(f"{file} cannot be read ({error.strerror})") from None
