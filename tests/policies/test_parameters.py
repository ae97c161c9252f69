"""Parameters of every searched policy: limits and files."""

import dataclasses
from types import ModuleType

import pytest

import policies
from policies import parameters
from policies.gaits import parameters as gaits
from policies.mpc import parameters as mpc
from policies.parameters import limits_of
from policies.trot import integral, open_loop, reference
from policies.virtual_model import parameters as virtual_model
from quad_env.files.reading import read_bytes

MODULES = {
    gaits: (gaits.GaitParameters, "walk", "restore the file as it shipped"),
    integral: (integral.IntegralParameters, "trot_integral", "restore the file as it shipped"),
    mpc: (mpc.MpcParameters, "mpc_wbc", "restore the file as it shipped"),
    open_loop: (open_loop.TrotParameters, "trot", "train search trot"),
    reference: (reference.ReferenceParameters, "trot_reference", "restore the file as it shipped"),
    virtual_model: (virtual_model.VirtualParameters, "trot_feedback", "restore the file as it shipped"),
}
"""Kind of the parameters -> a policy that has them, and the remedy for a damaged file."""
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
def test_a_missing_or_damaged_file_names_the_remedy(module, content, tmp_path, monkeypatch) -> None:
    _, name, remedy = MODULES[module]
    file = tmp_path / "parameters.json"
    if content is not None:
        file.write_text(content, encoding="utf-8")
    monkeypatch.setattr(parameters, "read_bytes", lambda _: read_bytes(file))
    with pytest.raises(policies.PolicyError, match=remedy):
        policies.make(name)
