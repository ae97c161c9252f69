"""Each command runs, prints what fits into a terminal and keeps its figures; mistakes are one line and exit code 2."""

import importlib
import json
import re
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from benchmarks.support.command import WIDTH
from benchmarks.view import CHROMIUM
from train.config import DEFAULTS

IN_PROCESS = ("single_env", "vector_env", "physics", "policies")
COMMANDS = (*IN_PROCESS, "peers", "training", "learners", "startup", "resume", "growth", "rendering")
COMMANDS += ("breaking_points", "cluster", "height_scan", "mpc", "recording", "solvers", "view")


def run(name: str, *arguments: object) -> int:
    code = importlib.import_module(f"benchmarks.{name}").main([str(argument) for argument in arguments])
    assert isinstance(code, int)
    return code


def figures(name: str, path: Path, printed: str) -> dict:
    """The figures of a file that fits its output."""
    table_lines = [line for line in printed.splitlines() if line.startswith(("│", "┃"))]
    assert table_lines
    assert max(map(len, table_lines)) <= WIDTH
    record = json.loads(path.read_text(encoding="utf-8"))
    assert record["benchmark"].endswith(name)
    assert record["machine"]["mujoco"] in printed
    return record["figures"]


@pytest.mark.parametrize("name", [*IN_PROCESS, "height_scan", "recording"])
def test_command_prints_and_keeps_its_figures(name: str, tmp_path: Path, capsys) -> None:
    assert run(name, "--quick", "--json", tmp_path / "kept.json") == 0
    assert figures(name, tmp_path / "kept.json", capsys.readouterr().out)


def test_breaking_points_stand_by_sets_of_levels(tmp_path: Path, capsys, monkeypatch) -> None:
    monkeypatch.setattr("evaluate.rollouts.rollout.STEPS", 120)
    assert run("breaking_points", "--quick", "--json", tmp_path / "kept.json") == 0
    found = figures("breaking_points", tmp_path / "kept.json", capsys.readouterr().out)["push, stand"]
    starts = ["levels", "every other", "middles", "three"]
    assert list(found) == [name for start in starts for name in (start, f"{start}, placed")] + ["reference"]
    assert [point["of"] for point in found["reference"]] == ["falls", "success"]


def test_cluster_has_the_bytes_of_worker_processes_though_workers_are_killed(tmp_path: Path, capsys) -> None:
    pytest.importorskip("ray")
    assert run("cluster", "--quick", "--json", tmp_path / "kept.json") == 0
    found = figures("cluster", tmp_path / "kept.json", capsys.readouterr().out)
    assert len(found["killed_after_s"]) <= 1  # none where the run ends before its moment
    assert found["identical"]
    assert found["core_hours"] > 0.0


def test_mpc_counts_every_call_of_one_robot(tmp_path: Path, capsys) -> None:
    assert run("mpc", "--quick", "--json", tmp_path / "kept.json") == 0
    found = figures("mpc", tmp_path / "kept.json", capsys.readouterr().out)
    plan, torques, action = (np.array(pairs) for pairs in found["one_robot_ms"].values())
    assert len(plan) == len(torques) == len(action) == 10
    assert (plan[:, 0] + torques[:, 0] < action[:, 0]).all()
    assert set(found["real_time"]["0.0"]) == {"1", "2"}


def test_solvers_are_held_to_a_reference(tmp_path: Path, capsys) -> None:
    pytest.importorskip("clarabel")
    assert run("solvers", "--quick", "--json", tmp_path / "kept.json") == 0
    found = figures("solvers", tmp_path / "kept.json", capsys.readouterr().out)
    for kind in ("MPC", "WBC"):
        used = found[f"{kind}, DAQP, as used"]
        assert used["failed"] == 0
        assert 0.0 < used["cost"] < 1e-4
        assert used["violation"] < 1e-4
        assert used["residual"] < 1e-8


def test_single_env_figures_are_those_of_its_rounds(tmp_path: Path, capsys) -> None:
    assert run("single_env", "--quick", "--json", tmp_path / "kept.json") == 0
    found = figures("single_env", tmp_path / "kept.json", capsys.readouterr().out)
    (ours,), (limit,) = found["seconds_per_step"].values()
    assert found["ratio"]["median"] == pytest.approx(limit / ours)
    assert found["overhead_us"]["median"] == pytest.approx((ours - limit) * 1e6)


def test_vector_env_bills_a_share_of_a_reset(tmp_path: Path, capsys) -> None:
    assert run("vector_env", "--quick", "--json", tmp_path / "kept.json") == 0
    found = figures("vector_env", tmp_path / "kept.json", capsys.readouterr().out)
    assert set(found) == {"flat 1", "flat 3", "rough 1", "rough 3"}
    assert all(each["reset_us"]["median"] > 0 for each in found.values())


def test_height_scan_sets_each_scan_beside_none_of_the_same_rounds(tmp_path: Path, capsys) -> None:
    assert run("height_scan", "--quick", "--json", tmp_path / "kept.json") == 0
    for size in figures("height_scan", tmp_path / "kept.json", capsys.readouterr().out).values():
        without, seen = (np.array(size["seconds_per_step"][name]) for name in ("none", "perfect"))
        assert size["time_ratio"]["perfect"]["median"] == pytest.approx(np.median(seen / without))


@pytest.mark.rendering
def test_rendering_counts_frames_of_every_ground(tmp_path: Path, capsys) -> None:
    assert run("rendering", "--quick", "--json", tmp_path / "kept.json") == 0
    rates = figures("rendering", tmp_path / "kept.json", capsys.readouterr().out)["frames_a_second"]
    assert all(rates[ground]["median"] > 0 for ground in ("flat", "stairs", "rough"))


def test_peers_in_a_process_of_its_own(tmp_path: Path, repository: Path) -> None:
    command = [sys.executable, "-m", "benchmarks.peers", "--quick", "--json", str(tmp_path / "kept.json")]
    done = subprocess.run(command, cwd=repository, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    found = figures("peers", tmp_path / "kept.json", done.stdout)
    assert set(found["ours"]) == {"AsyncVectorEnv", "SyncVectorEnv", "SubprocVecEnv", "DummyVecEnv", "our batch"}
    assert ("ant" in found) != ("Ant-v5 is not measured" in done.stdout)


def test_startup_counts_what_an_import_loads(tmp_path: Path, capsys) -> None:
    assert run("startup", "--quick", "--json", tmp_path / "kept.json") == 0
    found = figures("startup", tmp_path / "kept.json", capsys.readouterr().out)
    assert found["loaded_by_quad_env"] == []
    assert len(found["seconds"]) == 5


def test_growth_draws_a_plot(tmp_path: Path, capsys) -> None:
    assert run("growth", "--quick", "--out", tmp_path, "--json", tmp_path / "kept.json") == 0
    found = figures("growth", tmp_path / "kept.json", capsys.readouterr().out)
    assert set(found["envs"]["peak_bytes"]) == {"1", "2"}
    assert (tmp_path / "growth.png").read_bytes().startswith(b"\x89PNG")
    assert "<svg" in (tmp_path / "growth.svg").read_text(encoding="utf-8")


def test_training_repeats_a_finished_seed_for_other_code_alone(tmp_path: Path, capsys, monkeypatch) -> None:
    monkeypatch.setattr("benchmarks.training.git_revision", lambda _: "0" * 40)
    options = ("--quick", "--out", tmp_path, "--json", tmp_path / "kept.json")
    assert run("training", *options) == 0
    found = figures("training", tmp_path / "kept.json", capsys.readouterr().out)
    (piece,) = found["shares"]
    parts = (piece[name] for name in ("environment", "rollout", "learner"))
    assert all(seconds > 0 for seconds in parts)
    assert 0 < found["physics"][0] < piece["environment"] / piece["steps"]
    first = (tmp_path / "training.json").read_bytes()
    (kept,) = json.loads(first)["runs"]
    assert kept["finished"]
    assert kept["trace"][0]["steps"] == 0
    assert run("training", *options) == 0
    assert "1 seeds were already in" in capsys.readouterr().out
    assert (tmp_path / "training.json").read_bytes() == first
    monkeypatch.setattr("benchmarks.training.git_revision", lambda _: "0" * 40 + "-dirty")
    assert run("training", *options) == 0
    assert "were already in" not in capsys.readouterr().out
    assert len(json.loads((tmp_path / "training.json").read_bytes())["runs"]) == 2


def test_an_interrupted_training_keeps_its_judgements(tmp_path: Path, capsys, monkeypatch) -> None:
    from benchmarks.probes.training_run import Judgement

    def interrupted(*arguments):
        arguments[-1](Judgement(0, 0.5, 0.12))
        raise KeyboardInterrupt

    monkeypatch.setattr("benchmarks.probes.training_run.train_and_judge", interrupted)
    assert run("training", "--quick", "--out", tmp_path) == 130
    (kept,) = json.loads((tmp_path / "training.json").read_bytes())["runs"]
    assert not kept["finished"]
    assert kept["trace"] == [{"steps": 0, "seconds": 0.5, "velocity_error": 0.12}]


def test_learners_get_the_wall_time_of_ppo_and_begin_as_their_base(tmp_path: Path, capsys, monkeypatch) -> None:
    from benchmarks import learners

    monkeypatch.setattr(learners, "SHARED", {**learners.SHARED, "learning_starts": 10**9})
    monkeypatch.setattr(learners, "min", lambda starts, _: starts, raising=False)  # so that nothing is learnt
    assert run("learners", "--quick", "--learners", "sac", "crossq", "--json", tmp_path / "kept.json") == 0
    found = figures("learners", tmp_path / "kept.json", capsys.readouterr().out)
    base = DEFAULTS["residual"].base
    assert list(found) == [base, "ppo", "sac", "crossq"]
    for name in ("sac", "crossq"):
        assert found[name]["seconds"] >= found["ppo"]["seconds"]
        assert found[name]["updates"] == 0 < found["ppo"]["updates"]
        assert found[name]["scenarios"] == found[base]["scenarios"] != found["ppo"]["scenarios"]


def test_resume_compares_what_a_killed_run_ends_with(tmp_path: Path, capsys) -> None:
    assert run("resume", "--quick", "--json", tmp_path / "kept.json") == 0
    found = figures("resume", tmp_path / "kept.json", capsys.readouterr().out)
    (kill,) = found["kills"]
    assert found["same"] == kill["same"] == 1


def test_all_together_names_the_command_of_what_it_does_not_measure(tmp_path: Path, capsys, monkeypatch) -> None:
    from benchmarks import startup
    from benchmarks.support.command import Outcome

    monkeypatch.setattr(startup, "measure", lambda _: Outcome({}, ()))
    assert importlib.import_module("benchmarks.__main__").main(["--quick", "--json", str(tmp_path / "kept.json")]) == 0
    printed = capsys.readouterr().out
    assert set(figures("benchmarks", tmp_path / "kept.json", printed)) == {*IN_PROCESS, "startup"}
    for command in ("peers", "training", "growth"):
        assert f"python -m benchmarks.{command}" in printed


@pytest.mark.parametrize(
    ("name", "arguments", "words"),
    [
        ("single_env", ["--steps", "0"], "--steps must be from 1 to 1000"),
        ("single_env", ["--rounds", "0"], "--rounds must be from 1"),
        ("single_env", ["--step", "5"], "Unrecognized options"),
        ("vector_env", ["--envs", "0"], "--envs must be from 1"),
        ("vector_env", ["--envs", "2", "2"], "twice"),
        ("vector_env", ["--scenarios", "ice"], "valid: flat, push, rough"),
        ("height_scan", ["--scenarios", "ice"], "valid: flat, push, rough"),
        ("physics", ["--settings", "fast"], "valid: shipped"),
        ("physics", ["--threads", "0"], "--threads"),
        ("policies", ["--policies", "gallop"], "no policy 'gallop'"),
        ("policies", ["--calls", "1"], "--calls"),
        ("peers", ["--steps", "0"], "--steps"),
        ("peers", ["--envs", "0"], "--envs"),
        ("training", ["--seeds", "-1"], "--seeds"),
        ("learners", ["--learners", "dqn"], "unknown learner 'dqn'; there are sac, tqc, crossq"),
        ("training", ["--policy", "walk"], "--policy"),
        ("startup", ["--rounds", "-1"], "--rounds"),
        ("resume", ["--kills", "0"], "--kills"),
        ("growth", ["--envs"], "--envs"),
    ],
)
def test_a_mistake_is_one_line_and_exit_code_2(name: str, arguments: list[str], words: str, capsys, tmp_path) -> None:
    out = ["--out", str(tmp_path)] if name in {"training", "growth"} else []
    assert run(name, *out, *arguments) == 2
    printed = capsys.readouterr()
    (line,) = printed.err.splitlines()
    assert line.startswith("error: ")
    assert words in line
    assert printed.out == ""


def test_a_record_that_is_none_is_refused_and_left_alone(tmp_path: Path, capsys) -> None:
    (tmp_path / "training.json").write_text('{"runs": [{}]}', encoding="utf-8")
    assert run("training", "--quick", "--out", tmp_path) == 2
    assert "--out" in capsys.readouterr().err
    assert (tmp_path / "training.json").read_text(encoding="utf-8") == '{"runs": [{}]}'


@pytest.mark.rendering
@pytest.mark.skipif(not any(map(shutil.which, CHROMIUM)), reason="needs a browser: apt-get install chromium")
def test_view_is_watched_by_a_browser(tmp_path: Path, capsys) -> None:
    assert run("view", "--quick", "--json", tmp_path / "kept.json") == 0
    found = figures("view", tmp_path / "kept.json", capsys.readouterr().out)["view"]
    assert found["frames"] > 0.0
    assert found["real_time"] > 0.0
    assert 0.0 < found["first_frame"] < 60.0


def test_readme_lists_every_command(repository: Path) -> None:
    listed = re.findall(
        r"`python -m benchmarks(?:\.(\w+))?`", (repository / "benchmarks" / "README.md").read_text(encoding="utf-8")
    )
    assert {name for name in listed if name} == set(COMMANDS)
    assert "" in listed
