"""Pages of the failures that a report names: written once, kept after an interruption, and linked."""

import shutil
from dataclasses import replace
from pathlib import Path

import pytest

from evaluate.__main__ import main
from evaluate.commands import outputs, pages, replay
from evaluate.film.shooting import FilmSpec
from evaluate.records.store import EPISODES, read_run
from policies import registry
from quad_env.cli.command_line import UsageError


@pytest.fixture
def made(monkeypatch: pytest.MonkeyPatch) -> list[FilmSpec]:
    """Return the films that the command would write; each file contains only its title."""
    found: list[FilmSpec] = []

    def write(take: FilmSpec, path: Path, progress) -> None:
        progress(0.5)
        found.append(take)
        path.write_text(take.title, encoding="utf-8")

    monkeypatch.setattr(pages, "write_page", write)
    return found


@pytest.fixture
def copied(run, tmp_path: Path) -> Path:
    return Path(shutil.copytree(run.folder, tmp_path / "run"))


def test_each_page_is_made_once_and_the_report_links_it(copied, made, capsys) -> None:
    assert main(["report", str(copied), "--pages"]) == 0
    names = sorted(path.name for path in (copied / "pages").iterdir())
    assert len(names) == len(made) > 2
    page = (copied / "report.html").read_text(encoding="utf-8")
    assert all(f'href="pages/{name}"' in page for name in names)
    first = made[0]
    assert f"{first.policies[0].label}_{first.scenario.name}" in str(names)
    assert first.seed in read_run(copied).cells[0].seeds
    (copied / "pages" / names[1]).unlink()
    made.clear()
    pages.make_pages(read_run(copied), copied, trust=False)
    assert len(made) == 1
    assert (copied / "pages" / names[1]).is_file()


@pytest.mark.parametrize(("error", "code"), [(OSError(28, "No space left on device"), 2), (KeyboardInterrupt(), 130)])
def test_what_was_made_is_kept(copied, made, capsys, monkeypatch, error, code) -> None:
    write = pages.write_page

    def stop(take: FilmSpec, path: Path, progress) -> None:
        if made:
            raise error
        write(take, path, progress)

    monkeypatch.setattr(pages, "write_page", stop)
    assert main(["report", str(copied), "--pages"]) == code
    said = capsys.readouterr().err
    assert "1 of" in said
    assert "pages are there, and the same command goes on" in said
    assert said.count("\n") == 1
    assert ("No space left" in said) == (code == 2)
    assert len(list((copied / "pages").iterdir())) == 1


def test_pages_are_of_whole_runs_with_policies_that_are_there(copied, made, refused) -> None:
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(registry, "MAKERS", {})
        assert "the policy of that episode is not here" in refused(main, "report", copied, "--pages")
    (copied / "pages").write_text("", encoding="utf-8")
    assert "--pages: cannot write to the folder" in refused(main, "report", copied, "--pages")
    run = read_run(copied)
    with pytest.raises(UsageError, match="unfinished run; carry it on with --resume"):
        pages.make_pages(replace(run, cells=run.cells[:3]), copied, trust=False)
    (copied / EPISODES).unlink()
    for words in (("report", copied, "--pages"), ("replay", copied, 0)):
        assert "holds no finished part" in refused(main, *words)
    assert made == []


def test_a_page_shows_the_episode_and_another_policy_on_the_same_seed(run, tmp_path, monkeypatch, capsys) -> None:
    shown: list[FilmSpec] = []
    monkeypatch.setattr(replay, "write_page", lambda take, path, progress: shown.append(take))
    assert main(["replay", str(run.folder), "13", "--page", str(tmp_path / "a.html"), "--against", "stand"]) == 0
    cell = read_run(run.folder).cells[2]
    assert [policy.label for policy in shown[0].policies] == [cell.policy, "stand"] == ["trot", "stand"]
    assert (shown[0].seed, shown[0].scenario) == (cell.seeds[3], cell.scenario)
    assert capsys.readouterr().out.endswith(f"{tmp_path / 'a.html'}\n")


def test_files_that_can_hide_code_are_loaded_for_pages_where_they_are_trusted(copied, made, monkeypatch) -> None:
    given = []
    monkeypatch.setattr(pages, "load_policy", lambda label, _, trust: given.append((label, trust)))
    monkeypatch.setattr(pages.ReplayTarget, "film_spec", lambda *_: None)
    monkeypatch.setattr(pages, "write_page", lambda *_: None)
    monkeypatch.setattr(outputs, "write_results", lambda *_: 0)
    for word in ([], ["--trust"]):
        assert main(["report", str(copied), "--pages", *word]) == 0
    assert {trust for _, trust in given[: len(given) // 2]} == {False}
    assert {trust for _, trust in given[len(given) // 2 :]} == {True}
