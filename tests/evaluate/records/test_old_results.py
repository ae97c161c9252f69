"""Results that revision 2c74e47 wrote, before its modules moved, are reported, replayed and compared. The column
`outcome` and the start of the policies' digests were put in as 0.1.0 wrote them.

`python -m evaluate --policies trot document_repaired --scenarios flat push slope:6 --episodes 3 --trace compact` made
them there; the report and the traces are left out.
"""

import json
import shutil
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import pyarrow as pa
import pytest

from evaluate.__main__ import main
from evaluate.measures.catalogue import SINCE_ENERGY_2
from evaluate.records import manifest, provenance
from evaluate.records.episode_table import read_table
from evaluate.records.store import read_run
from tests.evaluate.altered import column, other

OLD = Path(__file__).parents[2] / "data" / "results_of_2c74e47"


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


def test_their_report_has_the_figures_that_it_had_by_the_rule_of_success_that_they_ran_under(folder, capsys) -> None:
    assert main(["report", str(folder)]) == 0
    said, printed = "Success is by the older rule success/1, under which these episodes ran", capsys.readouterr().out
    assert "slope:6" in printed
    assert said in " ".join(printed.split())
    assert said in (folder / "report.html").read_text()
    found = json.loads((folder / "results.json").read_text())
    assert found["versions"]["success_rule"] == "success/1"
    outcomes = found["policies"]["trot"]["scenarios"]["flat"]["outcomes"]
    assert list(outcomes) == ["succeeded", "off_command", "refused", "fell", "diverged"]
    assert sum(outcomes.values()) == 3
    then = json.loads((OLD / "results.json").read_text(encoding="utf-8"))["policies"]
    for policy, scenario, name in (("trot", "slope:6", "falls"), ("document_repaired", "push", "velocity_error")):
        now = found["policies"][policy]["scenarios"][scenario][name]
        assert now == then[policy]["scenarios"][scenario][name]


def test_outcomes_of_another_rule_are_compared_by_todays(run, tmp_path, capsys, refused) -> None:
    """The same episodes, as success/1 called them: standing was refused, or a success where little was asked."""
    outcomes = read_table(run.folder / "episodes.parquet").column("outcome").to_pylist()
    names = ["refused" if name == "stalled" else name for name in outcomes]
    assert "refused" in names
    versions = provenance.versions() | {"success_rule": "success/1"}
    old = other(run, tmp_path / "old", lambda rows: column(rows, "outcome", names), versions=versions)
    for pair, which in (((old, run.folder), "A"), ((run.folder, old), "B")):
        assert main(["compare", *map(str, pair)]) == 0
        said = " ".join(capsys.readouterr().out.split())
        assert f"by success/2: {which} ran under success/1 and was rescored, exactly" in said
        assert "success_rule was" in said
        assert "6 of 6" in said
    assert main(["compare", str(old), str(old)]) == 0
    assert "success and outcomes of both by success/1, the older rule" in " ".join(capsys.readouterr().out.split())
    row = names.index("refused")
    assert main(["replay", str(old), str(row)]) == 0
    assert "identical to the bit" in capsys.readouterr().out
    replace(manifest.read(old), versions=versions | {"success_rule": "success/9"}).begun().write(old)
    said = refused(main, "report", old)
    assert "its success rule is success/9; this version knows success/2 and success/1" in said


def test_energy_of_the_older_rule_is_read_named_and_compared_with_none_of_todays(run, tmp_path, capsys) -> None:
    """The same episodes as energy/1 wrote them: other energies, and fewer columns."""
    versions = {name: version for name, version in provenance.versions().items() if name != "energy_rule"}

    def as_then(rows: pa.Table) -> pa.Table:
        kept = rows.select([name for name in rows.column_names if name not in SINCE_ENERGY_2])
        return column(kept, "energy", [1.0] * len(rows))

    old = other(run, tmp_path / "old", as_then, versions=versions)
    assert main(["compare", str(old), str(run.folder)]) == 0
    said = " ".join(capsys.readouterr().out.split())
    assert "6 of 6" in said
    assert "energy_rule was energy/1 and is energy/2" in said
    assert main(["replay", str(old), "0"]) == 0
    assert "identical to the bit" in capsys.readouterr().out
    assert main(["report", str(old)]) == 0
    assert "by the older rule energy/1" in " ".join(capsys.readouterr().out.split())
    found = json.loads((old / "results.json").read_text())
    assert found["versions"]["energy_rule"] == "energy/1"
    cell = found["policies"]["trot"]["scenarios"]["flat"]
    assert (cell["energy"], cell["figures"]["step_rate"]) == (1.0, None)
    assert main(["compare", str(old), str(old)]) == 0
    assert "energy_rule" not in capsys.readouterr().out


@pytest.mark.parametrize(("policy", "scenario"), [("trot", "slope:6"), ("document_repaired", "push")])
def test_their_episodes_come_out_to_the_bit(capsys, policy, scenario) -> None:
    then, now = read_run(OLD).manifest, provenance.versions()
    if then.cpu != provenance.cpu_model() or any(then.versions[name] != now[name] for name in ("mujoco", "numpy")):
        pytest.skip("bits are those of one processor and library")
    assert main(["replay", str(OLD), "1", "--policy", policy, "--scenario", scenario]) == 0
    assert "identical to the bit" in capsys.readouterr().out


def test_they_are_compared_and_what_has_changed_is_named(folder, tmp_path, capsys) -> None:
    assert main(["compare", str(OLD), str(folder)]) == 0
    said = " ".join(capsys.readouterr().out.split())
    assert "6 of 6" in said
    assert said.endswith("A and B differ in: nothing that is known")
    digests = dict.fromkeys(read_run(OLD).manifest.policies, "2-")
    today = other(SimpleNamespace(folder=OLD), tmp_path / "b", policies=digests)
    assert main(["compare", str(OLD), str(today)]) == 0
    said = " ".join(capsys.readouterr().out.split())
    assert said.endswith("A and B differ in: the policy trot has changed; the policy document_repaired has changed")
