"""Results of older rules are refused in one line, which names the version that reads them."""

import json

import pytest

from evaluate.__main__ import main
from evaluate.records import manifest, provenance
from tests.evaluate.altered import other

WORDS = "its figures are not by success/2, energy/2, causes/1, this version's rules; revision 02bbde28 reads older ones"


@pytest.mark.parametrize("changes", [{"success_rule": "success/1"}, {"energy_rule": None}, {"cause_rule": "causes/9"}])
def test_figures_by_another_rule_are_one_line(run, tmp_path, refused, changes) -> None:
    versions = {name: rule for name, rule in (provenance.versions() | changes).items() if rule}
    old = other(run, tmp_path / "old", versions=versions)
    for words in (("report", old), ("replay", old, 0), ("compare", old, run.folder), ("compare", run.folder, old)):
        assert WORDS in refused(main, *words)


def test_a_manifest_of_0_1_0_is_one_line(run, tmp_path, refused) -> None:
    """The manifest has no hash, and its scenarios refer to modules of that version."""
    old = other(run, tmp_path / "old")
    found = json.loads((old / manifest.NAME).read_text())
    del found["sha256"], found["versions"]["success_rule"]
    found["scenarios"][0]["type"] = "quad_env.conditions.Scenario"
    (old / manifest.NAME).write_text(json.dumps(found))
    assert WORDS in refused(main, "report", old)
