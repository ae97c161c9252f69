"""Results that revision 2c74e47 wrote, before its modules moved, are reported, replayed, compared and scored again.

`python -m evaluate --policies trot document_repaired --scenarios flat push slope:6 --episodes 3 --trace compact` made
them there; the report and all traces but one are left out.
"""

import json
import shutil
from dataclasses import replace
from pathlib import Path

import pytest

from evaluate.__main__ import main
from evaluate.records import manifest, provenance
from evaluate.records.store import read_run

OLD = Path(__file__).parents[2] / "data" / "results_of_2c74e47"
UNKNOWN = "whether the policy trot has changed is not known, since that revision described policies differently"


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """A copy that may be written to."""
    return Path(shutil.copytree(OLD, tmp_path / "old"))


def test_they_are_read_with_their_scenarios() -> None:
    run = read_run(OLD)
    assert run.complete
    assert [(cell.policy, cell.scenario.name) for cell in run.cells] == [
        (policy, scenario) for scenario in ("flat", "push", "slope:6") for policy in ("trot", "document_repaired")
    ]
    flat, push, slope = run.manifest.scenarios
    assert (flat.pushes, push.pushes is not None) == (None, True)
    assert type(slope.terrain).__name__ == "Slope"


def test_their_report_has_the_figures_that_it_had(folder, capsys) -> None:
    then = json.loads((OLD / "results.json").read_text(encoding="utf-8"))["policies"]
    assert main(["report", str(folder), "--no-film"]) == 0
    assert "slope:6" in capsys.readouterr().out
    now = json.loads((folder / "results.json").read_text(encoding="utf-8"))["policies"]
    for policy, scenario, name in (("trot", "slope:6", "falls"), ("document_repaired", "push", "velocity_error")):
        assert now[policy]["scenarios"][scenario][name] == then[policy]["scenarios"][scenario][name]


@pytest.mark.parametrize(("policy", "scenario"), [("trot", "slope:6"), ("document_repaired", "push")])
def test_their_episodes_come_out_to_the_bit(capsys, policy, scenario) -> None:
    then, now = read_run(OLD).manifest, provenance.versions()
    if then.cpu != provenance.cpu_model() or any(then.versions[name] != now[name] for name in ("mujoco", "numpy")):
        pytest.skip("bits are those of one processor and library")
    assert main(["replay", str(OLD), "1", "--policy", policy, "--scenario", scenario]) == 0
    assert "identical to the bit" in capsys.readouterr().out


def test_they_are_compared_and_nothing_is_said_that_is_not_known(folder, run, capsys) -> None:
    assert main(["compare", str(OLD), str(folder)]) == 0
    said = " ".join(capsys.readouterr().out.split())
    assert "6 of 6" in said
    assert said.endswith("A and B differ in: nothing that is known")
    assert main(["compare", str(OLD), str(run.folder)]) == 0
    said = " ".join(capsys.readouterr().out.split())
    assert UNKNOWN in said
    assert "the policy trot has changed;" not in said


@pytest.mark.parametrize(("then", "now", "said"), [("a", "b", ["the policy trot has changed"]), ("a", "a", [])])
def test_digests_of_one_kind_tell_a_policy_that_has_changed(then, now, said) -> None:
    a, b = (
        replace(read_run(OLD).manifest, policies={"trot": provenance.DIGEST + 64 * letter}) for letter in (then, now)
    )
    assert manifest.differences(a, b) == said


def test_their_traces_are_scored_again(folder, capsys) -> None:
    assert main(["rescore", str(folder)]) == 0
    scored = json.loads((folder / "rescored.json").read_text(encoding="utf-8"))["policies"]
    assert list(scored) == ["document_repaired"]
    assert scored["document_repaired"]["scenarios"]["push"]["simple-quad/1"]["episodes"] == 3
    assert "push" in capsys.readouterr().out
