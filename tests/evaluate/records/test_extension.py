"""A finished run gets further policies and episodes, with the files of a run that had them from the start."""

import contextlib
import io
import shutil
from pathlib import Path

import pytest

from evaluate.__main__ import main
from evaluate.records.extension import extend_run
from evaluate.records.store import read_run
from evaluate.rollouts import rollout
from tests.evaluate.records.test_resume import OUTCOME, STEPS, a_page, assert_same
from tests.seams import replace_report, replace_simulation

SCENARIOS = ("--scenarios", "flat", "push:4", "--seed", "2", "--threads", "1")
SIMULATE = rollout.run_scenarios


def evaluate(*arguments: object) -> tuple[int, str]:
    """Return exit code and stderr."""
    error = io.StringIO()
    with contextlib.redirect_stdout(io.StringIO()), contextlib.redirect_stderr(error):
        code = main([str(argument) for argument in arguments])
    return code, error.getvalue()


@pytest.fixture(autouse=True)
def short(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(rollout, "STEPS", STEPS)
    replace_report(monkeypatch, a_page)


@pytest.fixture
def simulated(monkeypatch: pytest.MonkeyPatch) -> list[tuple[str, int]]:
    """Return a list that gets the policy and the number of episodes of every scenario of every simulation."""
    batches: list[tuple[str, int]] = []

    def simulate(policy, scenarios, **settings):
        batches.extend((type(policy).__name__, len(each.seeds)) for each in scenarios)
        return SIMULATE(policy, scenarios, **settings)

    replace_simulation(monkeypatch, simulate)
    return batches


def run_of(folder: Path, policies: tuple[str, ...], episodes: int) -> Path:
    """Run a short evaluation, and return its folder."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(rollout, "STEPS", STEPS)
        replace_report(patch, a_page)
        code, error = evaluate("--policies", *policies, "--episodes", episodes, *SCENARIOS, "--out", folder)
    assert code == 0, error
    return folder


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return the folder of a run of two policies and four episodes each."""
    return run_of(tmp_path_factory.mktemp("whole"), ("stand", "crouch"), 4)


@pytest.fixture(scope="module")
def one_policy(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return run_of(tmp_path_factory.mktemp("one"), ("stand",), 4)


@pytest.fixture(scope="module")
def few_episodes(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return run_of(tmp_path_factory.mktemp("few"), ("stand", "crouch"), 3)


def copied(folder: Path, to: Path) -> Path:
    return shutil.copytree(folder, to / "run")


def test_a_policy_is_added_and_only_its_episodes_are_simulated(one_policy, whole, tmp_path, simulated) -> None:
    folder = copied(one_policy, tmp_path)
    code, error = evaluate("--add", "crouch", "--threads", 1, "--out", folder)
    assert code == 0, error
    assert f"{folder}: 8 episodes are kept, 8 are simulated" in error
    assert [count for _, count in simulated] == [4, 4]
    assert len({policy for policy, _ in simulated}) == 1
    assert_same(folder, whole)


def test_episodes_are_added_and_only_they_are_simulated(few_episodes, whole, tmp_path, simulated) -> None:
    folder = copied(few_episodes, tmp_path)
    code, error = evaluate("--episodes", 4, "--out", folder, "--threads", 1)
    assert code == 0, error
    assert f"{folder}: 12 episodes are kept, 4 are simulated" in error
    assert [count for _, count in simulated] == [2, 2]  # one batch of both policies per scenario
    assert_same(folder, whole)


def test_policies_and_episodes_are_added_together_also_after_an_interruption(
    one_policy, whole, tmp_path, monkeypatch
) -> None:
    few = run_of(tmp_path / "few", ("stand",), 3)
    calls: list[int] = []
    more = ("--add", "crouch", "--episodes", 4, "--threads", 1)

    def interrupt(policy, scenarios, **settings):
        calls.append(len(scenarios))
        if len(calls) == 2:
            raise KeyboardInterrupt
        return SIMULATE(policy, scenarios, **settings)

    with monkeypatch.context() as patch:
        replace_simulation(patch, interrupt)
        assert evaluate(*more, "--at-once", 5, "--out", few)[0] == 130  # the scenarios in two batches
    assert not read_run(few).complete
    code, error = evaluate("--resume", "--threads", 1, "--out", few)
    assert code == 0, error
    assert_same(few, whole)


def test_a_process_that_is_killed_before_the_new_manifest_leaves_the_finished_run(
    one_policy, whole, tmp_path, monkeypatch
) -> None:
    folder = copied(one_policy, tmp_path)
    extended = read_run(whole).manifest

    def killed(*_args: object) -> None:
        raise SystemExit(9)

    with monkeypatch.context() as patch:
        patch.setattr(type(extended), "write", killed)
        with pytest.raises(SystemExit):
            extend_run(folder, extended)
    run = read_run(folder)
    assert (run.complete, run.stored, len(run.cells)) == (True, True, 2)
    code, error = evaluate("--add", "crouch", "--threads", 1, "--out", folder)
    assert code == 0, error
    assert_same(folder, whole)


@pytest.mark.parametrize(
    ("words", "complaint"),
    [
        ("--add stand --out RUN", "--policies: stand given more than once"),
        ("--add hop --out RUN", "--policies: "),
        ("--add crouch --seed 5 --out RUN", "--add: keeps the options of the run, but --seed was 2, not 5"),
        ("--add crouch --episodes 2 --out RUN", "--episodes: the run has 4, got 2; valid: more"),
        ("--add crouch --resume --out RUN", "--add: extends a finished run, got --resume as well; valid: one of them"),
        ("--add crouch --out FOLDER/none", "--add: FOLDER/none holds no run that was begun"),
        ("axes push --add crouch --out FOLDER/none", "--add: extends a finished run, got another command"),
    ],
)
def test_bad_input_is_one_line_and_changes_nothing(one_policy, tmp_path, words, complaint) -> None:
    folder = copied(one_policy, tmp_path)
    text = words.replace("RUN", str(folder)).replace("FOLDER", str(tmp_path))
    code, error = evaluate(*text.split())
    assert code == 2
    assert complaint.replace("FOLDER", str(tmp_path)) in error.splitlines()[-1]
    for name in OUTCOME:
        assert (folder / name).read_bytes() == (one_policy / name).read_bytes()


def test_an_unfinished_run_is_finished_first(one_policy, tmp_path) -> None:
    folder = copied(one_policy, tmp_path)
    (folder / "episodes.parquet").unlink()
    code, error = evaluate("--add", "crouch", "--out", folder)
    assert code == 2
    assert f"--add: {folder} is not finished; valid: a finished run" in error


def test_a_part_of_a_run_is_not_extended(tmp_path) -> None:
    words = ["--policies", "stand", "--episodes", 2, *SCENARIOS, "--part", "1/2", "--out", tmp_path / "part"]
    code, error = evaluate(*words)
    assert code == 0, error
    for extension in (["--add", "crouch"], ["--episodes", 5]):
        code, error = evaluate(*extension, "--out", tmp_path / "part")
        assert code == 2
        assert f"{extension[0]}: {tmp_path / 'part'} is part 1/2 of a run; valid: a finished run" in error


def test_another_version_of_the_code_is_refused(one_policy, tmp_path, monkeypatch) -> None:
    from evaluate.records import manifest

    folder = copied(one_policy, tmp_path)
    monkeypatch.setattr(manifest, "code_digest", lambda: "0" * 64)
    code, error = evaluate("--add", "crouch", "--out", folder)
    assert code == 2
    assert "cannot be extended, for the code of quad_env, policies or evaluate has changed" in error


def test_more_episodes_with_other_options_are_a_new_run(one_policy, tmp_path) -> None:
    folder = copied(one_policy, tmp_path)
    code, error = evaluate("--policies", "crouch", "--episodes", 5, *SCENARIOS, "--out", folder)
    assert code == 0, error
    assert "are kept" not in error
    assert list(read_run(folder).manifest.policies) == ["crouch"]
