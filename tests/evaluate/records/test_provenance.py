"""Provenance of results: a digest changes with its object and with nothing else."""

import json
import os
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import policies
from evaluate.records import manifest, provenance
from evaluate.records.provenance import code_digest, policy_digest
from quad_env.robots.robot import Robot
from quad_env.robots.simple_quad import SIMPLE_QUAD


def elsewhere(repository: Path, code: str) -> str:
    """Return the text that code prints in another process, with another BLAS kernel."""
    command, chosen = [sys.executable, "-c", code], os.environ | {"OPENBLAS_CORETYPE": "Prescott"}
    return subprocess.run(command, cwd=repository, env=chosen, capture_output=True, text=True, check=True).stdout


def test_every_policy_has_a_digest_of_its_own_which_is_the_same_in_another_process(repository) -> None:
    code = (
        "import policies\nfrom evaluate.records.provenance import policy_digest\n"
        "print(*(policy_digest(policies.make(name, servo='own')) for name in policies.names()))"
    )
    digests = [policy_digest(policies.make(name, servo="own")) for name in policies.names()]
    assert elsewhere(repository, code).split() == digests
    assert len(set(digests)) == len(digests)


def test_one_parameter_more_or_less_shows() -> None:
    trot = policies.Trot()
    other = replace(trot.parameters, duty=float(np.nextafter(trot.parameters.duty, 1.0)))
    assert policy_digest(policies.Trot(other)) != policy_digest(trot)
    assert policy_digest(policies.Trot(replace(other, duty=trot.parameters.duty))) == policy_digest(trot)


@pytest.mark.parametrize("part", ["weights", "biases", "authority", "base"])
def test_one_weight_more_or_less_shows(part) -> None:
    before, changed = policies.make("residual"), policies.make("residual")
    assert policy_digest(before) == policy_digest(changed)
    if part == "authority":
        changed.authority = changed.authority + np.float32(1e-6)
    elif part == "base":
        changed.base = policies.Stand()
    else:
        first, *rest = getattr(changed.network, part)
        first = first.copy()
        first.flat[0] = np.nextafter(first.flat[0], np.float32(1.0))
        changed.network = replace(changed.network, **{part: (first, *rest)})
    assert policy_digest(before) != policy_digest(changed)


def test_arrays_of_objects_count_by_what_they_hold_not_by_where_that_lies() -> None:
    """The digest of an array of objects depends on their values and not on their addresses.

    Otherwise a run with an external policy that records its failures in such an array could not be resumed.
    """

    def noting(*failures):
        policy = policies.make("trot")
        policy.failure = np.array(failures, dtype=object)
        return policy_digest(policy)

    assert noting("".join(["la", "te"]), None) == noting("".join(["l", "ate"]), None) != noting(None, None)


def test_the_codes_digest_is_of_names_and_contents(tmp_path, monkeypatch) -> None:
    def digest() -> str:
        code_digest.cache_clear()
        return code_digest()

    monkeypatch.setattr(provenance, "REPOSITORY", tmp_path)
    found = [digest()]
    for name, content in (("a.py", "1"), ("a.py", "2"), ("b.json", "2"), ("c.txt", "no code")):
        (tmp_path / "policies").mkdir(exist_ok=True)
        (tmp_path / "policies" / name).write_text(content, encoding="utf-8")
        found.append(digest())
    code_digest.cache_clear()
    assert len(set(found)) == 4
    assert found[3] == found[4]


@pytest.fixture
def sources(tmp_path, monkeypatch) -> Path:
    """Create a repository with one module for the code digest."""
    module = tmp_path / "policies" / "a.py"
    module.parent.mkdir()
    module.write_text('"""Doc."""\n\nX = 1\n"""Unit."""\n\n\ndef f():\n    return "text"\n', encoding="utf-8")
    monkeypatch.setattr(provenance, "REPOSITORY", tmp_path)
    return module


@pytest.mark.parametrize(
    ("old", "new", "counts"),
    [
        ("X = 1", "X = 1  # why", False),
        ("Doc.", "Another summary.", False),
        ("Unit.", "Another unit.", False),
        ('return "text"', '"""Return a text."""\n    return "text"', False),
        ("X = 1", "X = (\n    1\n)", False),
        ("X = 1", "X = 2", True),
        ("X = 1", "Y = 1", True),
        ("X = 1", "X = 1.0", True),
        ('return "text"', 'return "other"', True),
        ('return "text"', '"text"', True),
    ],
)
def test_the_codes_digest_is_of_statements_not_of_comments_and_docstrings(sources, old, new, counts) -> None:
    code_digest.cache_clear()
    before = code_digest()
    content = sources.read_text(encoding="utf-8")
    assert old in content
    sources.write_text(content.replace(old, new), encoding="utf-8")
    code_digest.cache_clear()
    assert (code_digest() != before) == counts
    code_digest.cache_clear()


def test_a_policys_robot_shows_wherever_its_files_lie_and_whatever_was_asked_of_it() -> None:
    """The digest contains the robot, but neither the folder of its files nor its cached values."""

    def digest(robot: Robot) -> str:
        policy = policies.make("stand")
        policy.robot = robot
        return policy_digest(policy)

    fresh, asked = replace(SIMPLE_QUAD), replace(SIMPLE_QUAD, mjcf=Path("/elsewhere") / SIMPLE_QUAD.mjcf.name)
    assert asked.side[0] == 1.0
    assert digest(fresh) == digest(asked)
    assert digest(replace(SIMPLE_QUAD, foot_radius=0.03)) != digest(fresh)


@pytest.mark.skipif(
    "X86_V3" not in str(provenance.versions()["simd"]) or "openblas" not in provenance.blas(),
    reason="for OpenBLAS on an x86 processor",
)
def test_the_blas_kernel_is_recorded_and_named_where_it_differs(repository, run) -> None:
    code = "import json\nfrom evaluate.records.provenance import versions\nprint(json.dumps(versions()))"
    here, there = provenance.versions(), json.loads(elsewhere(repository, code))
    assert {each for each in here if there[each] != here[each]} == {"blas"}
    first = replace(manifest.read(run.folder), versions=here).with_fingerprint()
    second = replace(first, versions=there).with_fingerprint()
    assert manifest.differences(first, second) == [f"blas was {here['blas']} and is {there['blas']}"]
    assert first.fingerprint == second.fingerprint  # equal rows then give equal files
