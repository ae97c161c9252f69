"""Each study runs the episodes of its options, with seeds of the right family; user errors are one line."""

import pytest

from quad_env.seeding import episode_seeds
from research.__main__ import main
from tests.batches import begun
from tests.seams import short_episodes

BRIEF = 130
"""Number of control steps of an episode."""


def drawn(seed: int, count: int, purpose: str = "evaluation") -> tuple[int, ...]:
    return tuple(episode_seeds(purpose, seed, count).tolist())


RUNS = {
    "recovery --robots 2 --seeds search": ({drawn(5, 2, "search")}, "standing within 5 s"),
    "jump --robots 2": ({drawn(5, 2)}, "landed standing"),
}


@pytest.mark.parametrize("words", RUNS, ids=lambda words: words.split()[0])
def test_a_study_runs_the_episodes_of_its_options(words: str, monkeypatch, capsys) -> None:
    short_episodes(monkeypatch, BRIEF)
    seeds, said = RUNS[words]
    with begun() as batches:
        assert main([*words.split(), "--seed", "5"]) == 0
    assert {batch.seeds for batch in batches} == seeds
    assert said in capsys.readouterr().out


@pytest.mark.parametrize(
    ("words", "said"),
    [
        ("jump --robots 100000000000", "--robots must be from 1 to 65536, not 100000000000"),
        ("calibration --episodes", "--episodes and --fall-probabilities must each have at least one value"),
        ("calibration --only nothing --episodes 8", "--only: no row is named like nothing"),
        ("estimation --sensors truth", "--sensors: the estimator kalman has no sensors"),
        ("estimation --page nowhere.md", "cannot read the page nowhere.md"),
        ("gaits nowhere.md", "cannot read the page nowhere.md"),
        ("publish no-such-run", "no run in no-such-run"),
        ("ablations --variants brainless", "--variants: unknown 'brainless'; valid:"),
    ],
)
def test_a_mistake_is_one_line_and_nothing_is_made(words: str, said: str, tmp_path, monkeypatch, refused) -> None:
    monkeypatch.chdir(tmp_path)
    assert said in refused(main, *words.split())
    assert list(tmp_path.rglob("*.*")) == []
