"""Chunk store of a running evaluation: parts by cell, episodes, seeds and run, and removal of other runs' parts."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from evaluate.cells import EpisodeChunk, evaluation_seeds
from evaluate.records.manifest import CHUNKS, Manifest, differences
from evaluate.records.provenance import versions
from evaluate.records.store import ChunkStore, is_unfinished, read_run, remove_chunks
from evaluate.rollouts.battery import resolve
from quad_env.cli.command_line import UsageError

FLAT, PUSH = resolve(("flat", "push:3"))
EPISODES = 6


@pytest.fixture
def manifest() -> Manifest:
    """Make a run of two policies on two scenarios, six episodes each."""
    return Manifest(
        policies={"a": "1", "b": "2"},
        scenarios=(FLAT, PUSH),
        seed=5,
        episodes=EPISODES,
        steps=500,
        versions=versions(),
        code="code",
        cpu="cpu",
        options={},
        threads=1,
    ).with_fingerprint()


@pytest.fixture
def part(made_up_cell):
    """Return a function that makes a part of a cell: policy, scenario, indices of its
    episodes, with the seeds of a run.
    """

    def make(policy="a", scenario=FLAT, numbers=(0, 1, 2), seed=5) -> EpisodeChunk:
        of = np.array(numbers)
        cell = made_up_cell(policy, of % 2 == 1, 0.1 * of, scenario)
        return EpisodeChunk(of, replace(cell, seeds=evaluation_seeds(seed, 10)[of]))

    return make


def names(folder: Path) -> list[str]:
    return sorted(path.name for path in (folder / CHUNKS).iterdir())


def errors(chunks) -> list[list[float]]:
    """Return the errors of the parts' episodes, in tenths of their indices."""
    return [(10.0 * chunk.cell.measures.velocity_error).round().tolist() for chunk in chunks]


def test_parts_go_to_the_place_of_their_cell_and_come_back_from_there_alone(tmp_path, manifest, part) -> None:
    """Scenario 1 of two policies, policy 1, is cell 1 · 2 + 1."""
    store = ChunkStore(tmp_path, manifest, True)
    for each in part(), part(numbers=(3, 4, 5)), part("b", PUSH), part("b", FLAT, (2, 3)):
        store.save(each)
    run = manifest.fingerprint[:8]
    assert names(tmp_path) == [
        f"{cell}-{first}-{run}.parquet"
        for cell, first in [("00000", "0000000"), ("00000", "0000003"), ("00001", "0000002"), ("00003", "0000000")]
    ]
    assert errors(store.load("a", FLAT)) == [[0, 1, 2], [3, 4, 5]]
    assert errors(store.load("b", FLAT)) == [[2, 3]]
    assert errors(store.load("b", PUSH)) == [[0, 1, 2]]
    assert store.load("a", PUSH) == []
    assert [each.episode_indices.tolist() for each in store.load("a", FLAT)] == [[0, 1, 2], [3, 4, 5]]


def test_no_episode_is_found_twice(tmp_path, manifest, part) -> None:
    """A part that shares an episode with a loaded part is not loaded; its other episodes are simulated again."""
    store = ChunkStore(tmp_path, manifest, True)
    store.save(part(numbers=(0, 1, 2)))
    store.save(part(numbers=(2, 3)))
    store.save(part(numbers=(4, 5)))
    assert errors(store.load("a", FLAT)) == [[0, 1, 2], [4, 5]]


def test_parts_of_other_runs_of_other_seeds_and_of_later_episodes_are_left_out(tmp_path, manifest, part) -> None:
    store = ChunkStore(tmp_path, manifest, True)
    other = replace(manifest, code="other").with_fingerprint()
    ChunkStore(tmp_path, other, True).save(part(numbers=(0, 1)))
    store.save(part(numbers=(2, 3), seed=6))
    store.save(part(numbers=(5, 6)))
    (tmp_path / CHUNKS / f"00000-0000001-{'0' * 8}.parquet").write_bytes(b"damaged")
    store.save(part(numbers=(4,)))
    assert errors(store.load("a", FLAT)) == [[4]]


def test_a_folder_is_another_run_s_until_the_first_part_and_only_this_run_s_then(tmp_path, manifest, part) -> None:
    """Before the first part, parts of another run are neither loaded nor removed; other files stay."""
    before = ChunkStore(tmp_path, replace(manifest, code="before").with_fingerprint())
    before.save(part(numbers=(0, 1)))
    before.save(part(numbers=(2, 3)))
    (tmp_path / CHUNKS / ".00000-0000002.parquet.abcdefgh").touch()
    (tmp_path / CHUNKS / "mine.parquet").touch()
    store = ChunkStore(tmp_path, manifest)
    assert store.load("a", FLAT) == ()
    assert len(names(tmp_path)) == 4
    assert read_run(tmp_path).manifest == before.manifest
    store.save(part(numbers=(4, 5)))
    assert names(tmp_path) == [f"00000-0000004-{manifest.fingerprint[:8]}.parquet", "mine.parquet"]
    assert read_run(tmp_path).manifest == manifest
    store.save(part(numbers=(0, 1)))
    assert errors(store.load("a", FLAT)) == [[0, 1], [4, 5]]


def test_a_run_under_way_has_the_cells_of_which_every_episode_is_there(tmp_path, manifest, part, capsys) -> None:
    """Episodes are in the order of their indices, in any order of storage.

    Incomplete cells cause no warning.
    """
    store = ChunkStore(tmp_path, manifest)
    for each in part("b", PUSH, (5, 3, 4)), part("b", PUSH, (0, 2, 1)), part("a", PUSH), part("a", FLAT, (1, 2)):
        store.save(each)
    run = read_run(tmp_path)
    assert [(cell.policy, cell.scenario) for cell in run.cells] == [("b", PUSH)]
    assert (10.0 * run.cells[0].measures.velocity_error).round().tolist() == [0, 1, 2, 3, 4, 5]
    assert run.cells[0].seeds.tolist() == evaluation_seeds(5, EPISODES).tolist()
    assert (run.complete, run.stored, is_unfinished(tmp_path)) == (False, False, True)
    assert capsys.readouterr().err == ""


def test_how_many_parts_are_left_out_is_said_and_later_episodes_are_none_of_them(
    tmp_path, manifest, part, capsys
) -> None:
    store = ChunkStore(tmp_path, manifest)
    store.save(part(numbers=(0, 1)))
    store.save(part(numbers=(2, 3), seed=6))
    store.save(part(numbers=(6, 7)))
    assert read_run(tmp_path).cells == ()
    assert capsys.readouterr().err.startswith("1 of 2 parts in ")


def test_removing_the_parts_leaves_what_is_none_of_them(tmp_path, manifest, part) -> None:
    store = ChunkStore(tmp_path, manifest)
    store.save(part())
    (tmp_path / ".results.json.abcdefgh").touch()
    (tmp_path / ".results.json.abcdefghi").touch()
    remove_chunks(tmp_path)
    assert sorted(path.name for path in tmp_path.iterdir()) == [".results.json.abcdefghi", "manifest.json"]
    assert not is_unfinished(tmp_path)


def test_a_policy_that_runs_on_some_scenarios_has_no_cells_on_others(manifest) -> None:
    limited = replace(manifest, only_on={"a": [PUSH.name]})
    assert limited.cells == [(FLAT, "b"), (PUSH, "a"), (PUSH, "b")]


def test_a_run_until_settled_is_the_same_run_at_every_look_and_open_until_it_ends(manifest) -> None:
    """A different limit, a run with fixed episodes, and different seeds are other runs."""
    first = replace(manifest, limit=40, episodes=10).with_fingerprint()
    changes = {"episodes": 20, "ended": "settled", "threads": 2, "options": {"x": 1}, "date": "2026-01-01"}
    later = replace(first, **changes).with_fingerprint()
    assert later.fingerprint == first.fingerprint
    assert (manifest.is_unsettled, first.is_unsettled, later.is_unsettled) == (False, True, False)
    for other in ({"limit": 80}, {"seed": 6}, {"steps": 1}, {"cpu": "x"}, {"policies": {"a": "1"}}):
        assert replace(first, **other).with_fingerprint().fingerprint != first.fingerprint
    assert replace(manifest, episodes=7).with_fingerprint().fingerprint != manifest.fingerprint


def test_a_manifest_that_was_changed_is_refused(tmp_path, manifest) -> None:
    manifest.write(tmp_path)
    text = (tmp_path / "manifest.json").read_text()
    for old, new in (('"threads": 1', '"threads": 2'), ('"date": ""', '"date": "x"'), ('"seed": 5', '"seed": 6')):
        assert old in text
        (tmp_path / "manifest.json").write_text(text.replace(old, new))
        with pytest.raises(UsageError, match="has been changed since it was written"):
            read_run(tmp_path)


def test_what_may_change_figures_is_named_of_what_both_runs_have(manifest) -> None:
    then = replace(manifest, versions={"numpy": "1", "git_revision": "x", "old": "1"})
    push = replace(PUSH, severity=9.0)
    now = replace(
        manifest,
        versions={"numpy": "2", "git_revision": "y", "new": "1"},
        policies={"a": "9", "c": "3"},
        scenarios=(FLAT, push),
        steps=600,
        cpu="other",
        code="other",
        seed=8,
        threads=8,
    )
    assert differences(then, now) == [
        "numpy was 1 and is 2",
        "the code of quad_env, policies or evaluate has changed",
        "the processor was cpu and is other",
        "an episode had 500 steps and has 600",
        "the policy a has changed",
        f"the scenario {PUSH.name} has changed",
    ]
    assert differences(then, then) == []
