"""The parameters of model-predictive control: their limits and their file."""

import dataclasses
from pathlib import Path

import pytest

import policies
from policies.mpc.parameters import PARAMETERS_FILE, SEARCH_RANGES, MpcParameters, read_parameters
from policies.parameters import limits_of


def test_limits_hold_the_search_ranges_and_leave_no_parameter_out() -> None:
    limits = limits_of(MpcParameters)
    assert set(limits) == {field.name for field in dataclasses.fields(MpcParameters)}
    for name, (low, high) in SEARCH_RANGES.items():
        assert limits[name][0] <= low < high <= limits[name][1], name


@pytest.mark.parametrize("name", ["mpc", "mpc_wbc"])
def test_the_trot_has_those_of_the_file(name: str) -> None:
    assert policies.make(name).parameters == read_parameters(PARAMETERS_FILE)


@pytest.mark.parametrize("content", [None, "{", "[]", '{"gallop": 1}', '{"frequency": 2.5}'])
def test_missing_or_damaged_parameter_file_names_the_search(tmp_path: Path, content: str | None) -> None:
    file = tmp_path / "mpc_wbc.json"
    if content is not None:
        file.write_text(content, encoding="utf-8")
    with pytest.raises(policies.PolicyError, match="train search feedback --policy mpc_wbc"):
        read_parameters(file)
