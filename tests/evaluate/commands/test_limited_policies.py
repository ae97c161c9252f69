"""A policy that is restricted to some scenarios is not reported as incomplete on the others."""

import json
import shutil
from pathlib import Path

import pytest

from evaluate.__main__ import main
from evaluate.commands.options import DEFAULT_POLICIES, WALKING_POLICIES, EvaluateOptions
from evaluate.commands.plan import check, select_policies
from evaluate.hardware import IDEAL, HardwareConfig
from evaluate.records.store import FILES, read_run
from evaluate.rollouts import rollout
from evaluate.rollouts.battery import BATTERIES, resolve
from quad_env.cli.command_line import UsageError
from quad_env.robots.simple_quad import SIMPLE_QUAD
from tests.quad_env.robots.made import Made

RUN = ["--policies", "document@flat", "trot", "stand", "--scenarios", "push", "flat", "--episodes", "2"]
CELLS = {"trot": ["push", "flat"], "stand": ["push", "flat"], "document": ["flat"]}


@pytest.fixture(autouse=True)
def short(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(rollout, "STEPS", 120)


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("limited")
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(rollout, "STEPS", 120)
        assert main([*RUN, "--out", str(folder)]) == 0
    return folder


def cells(folder: Path) -> dict[str, list[str]]:
    results = json.loads((folder / "results.json").read_text(encoding="utf-8"))
    assert results["complete"] is True
    return {policy: list(each["scenarios"]) for policy, each in results["policies"].items()}


def test_it_runs_on_its_scenarios_alone_and_the_run_is_complete(whole) -> None:
    assert cells(whole) == CELLS
    assert read_run(whole).complete
    assert "Interrupted" not in (whole / "report.html").read_text(encoding="utf-8")
    assert {path.name for path in whole.iterdir()} == {*FILES}


def test_its_report_comparison_and_episodes_are_made_again(whole, tmp_path, capsys) -> None:
    shutil.copytree(whole, tmp_path, dirs_exist_ok=True)
    assert main(["report", str(tmp_path)]) == 0
    capsys.readouterr()
    assert cells(tmp_path) == CELLS
    assert main(["compare", str(whole), str(tmp_path)]) == 0
    assert "5 of 5" in capsys.readouterr().out
    assert main(["replay", str(whole), "1", "--policy", "document"]) == 0
    assert "identical to the bit" in capsys.readouterr().out


@pytest.mark.parametrize("full", [False, True])
def test_the_default_is_everyone_that_walks_on_the_battery_and_the_document_on_flat_ground_alone(
    tmp_path, full
) -> None:
    plan = check(EvaluateOptions(out=tmp_path, full=full))
    battery = [scenario.name for scenario in BATTERIES["default" if full else "quick"](SIMPLE_QUAD)]
    article = ("document", "document_repaired")
    assert list(plan.manifest.policies) == [*article, *WALKING_POLICIES]
    assert plan.manifest.only_on == dict.fromkeys(article, ("flat",))
    everywhere = {(scenario, policy) for scenario in battery for policy in WALKING_POLICIES}
    assert {(scenario.name, policy) for scenario, policy in plan.manifest.cells} == everywhere | {
        ("flat", name) for name in article
    }


def test_of_scenarios_without_flat_ground_the_default_leaves_the_document_out() -> None:
    labelled = select_policies(DEFAULT_POLICIES, resolve(("push",)), IDEAL)
    assert tuple(policy.label for policy in labelled) == WALKING_POLICIES


def test_a_folder_may_have_an_at_sign(tmp_path) -> None:
    shutil.copytree(Path(__file__).parents[3] / "models" / "residual", tmp_path / "mine@home")
    (labelled,) = select_policies((f"{tmp_path}/mine@home/",), resolve(("flat",)), IDEAL)
    assert (labelled.label, labelled.only_on) == (f"{tmp_path}/mine@home", ())


def test_trained_policies_of_the_default_that_a_robot_has_not_are_left_out_in_a_line(capsys, tmp_path) -> None:
    own = HardwareConfig(robot=str(Made().write(tmp_path, "dog.xml")))
    compared = select_policies(DEFAULT_POLICIES, resolve(("flat",), own.robot_model), own)
    named = ["trot", "trot_feedback", "trot_integral", "mpc_wbc"]
    assert [policy.label for policy in compared] == ["document", "document_repaired", *named]
    said = capsys.readouterr().err
    assert said == "left out, since dog has no such trained policy: residual, robust\n"


def test_a_trained_policy_that_is_asked_for_by_name_is_not_left_out(tmp_path) -> None:
    own = HardwareConfig(robot=str(Made().write(tmp_path, "dog.xml")))
    with pytest.raises(UsageError, match="no trained policy in"):
        select_policies(("trot", "robust"), resolve(("flat",), own.robot_model), own)
