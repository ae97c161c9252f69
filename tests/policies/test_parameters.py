"""Parameters of every searched policy: their limits, and their files."""

import dataclasses
from types import ModuleType

import pytest

import policies
from policies.gaits import parameters as gaits
from policies.mpc import parameters as mpc
from policies.parameters import limits_of
from policies.trot import feedback_parameters, integral, open_loop

MODULES = {
    feedback_parameters: (feedback_parameters.FeedbackParameters, "trot_feedback", "feedback"),
    gaits: (gaits.GaitParameters, "walk", "gait"),
    integral: (integral.IntegralParameters, "trot_integral", "feedback --policy trot_integral"),
    mpc: (mpc.MpcParameters, "mpc_wbc", "feedback --policy mpc_wbc"),
    open_loop: (open_loop.TrotParameters, "trot", "trot"),
}
"""Kind of the parameters, a policy that has them, and the search that writes their file."""
EACH = pytest.mark.parametrize("module", MODULES, ids=lambda module: module.__name__)
DAMAGED = ["{", "[]", '{"gallop": 1}', '{"frequency": "fast"}', '{"frequency": 7}']


@EACH
def test_limits_hold_the_search_ranges_and_leave_no_parameter_out(module: ModuleType) -> None:
    kind, *_ = MODULES[module]
    limits = limits_of(kind)
    assert set(limits) == {field.name for field in dataclasses.fields(kind)}
    for name, (low, high) in getattr(module, "SEARCH_RANGES", {}).items():
        assert limits[name][0] <= low < high <= limits[name][1], name


@EACH
@pytest.mark.parametrize("content", [None, *DAMAGED])
def test_a_missing_or_damaged_file_names_the_search(module, content, tmp_path, monkeypatch) -> None:
    _, name, search = MODULES[module]
    file = tmp_path / "parameters.json"
    if content is not None:
        file.write_text(content, encoding="utf-8")
    monkeypatch.setattr(module, "PARAMETERS_FILE", file)
    with pytest.raises(policies.PolicyError, match=f"train search {search}`"):
        policies.make(name)
