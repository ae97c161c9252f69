"""The documentation site: built without a warning, no broken link, nothing from a network; its notebooks run."""

import json
import re
import subprocess
import sys
from collections.abc import Iterator
from html.parser import HTMLParser
from pathlib import Path
from urllib.parse import unquote, urlsplit

import pytest

import policies
import quad_env

REPOSITORY = Path(__file__).parents[1]
NOTEBOOKS = sorted((REPOSITORY / "docs" / "notebooks").glob("*.ipynb"))
LONG, SHORT = '"--episodes", "16"', '"--episodes", "2", "--threads", "1"'
"""What a notebook says, and what is run."""
LOADING = {"img": "src", "link": "href", "script": "src", "source": "src"}
"""Attributes by which a page loads something by itself."""


class Page(HTMLParser):
    """What a page has: ids, links, and what it loads."""

    def __init__(self, path: Path) -> None:
        super().__init__()
        self.ids: set[str] = set()
        self.links: list[str] = []
        self.loaded: list[str] = []
        self.feed(path.read_text(encoding="utf-8"))

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        found = {name: value for name, value in attrs if value}
        self.ids |= {found[name] for name in ("id", "name") if name in found}
        if tag == "a" and "href" in found:
            self.links.append(found["href"])
        if tag in LOADING and (target := found.get(LOADING[tag])) and found.get("rel") != "canonical":
            self.loaded.append(target)


def pages_of(folder: Path) -> dict[Path, Page]:
    return {path.resolve(): Page(path) for path in sorted(folder.rglob("*.html"))}


def broken_links(folder: Path) -> Iterator[str]:
    """What pages in a folder link to or load in it that is not there: files, and places in pages."""
    pages = pages_of(folder)
    for path, page in pages.items():
        for link in (*page.links, *page.loaded):
            parts = urlsplit(link)
            if parts.scheme or parts.netloc:
                continue
            target = (path.parent / unquote(parts.path)).resolve() if parts.path else path
            place = unquote(parts.fragment)
            if not target.is_file() or (place and target in pages and place not in pages[target].ids):
                yield f"{path.relative_to(folder.resolve())}: {link}"


def loaded_from_elsewhere(folder: Path) -> list[str]:
    return [link for page in pages_of(folder).values() for link in page.loaded if urlsplit(link).netloc]


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The site, built by the command in CONTRIBUTING.md but elsewhere and without running the notebooks; a warning ends
    it."""
    folder = tmp_path_factory.mktemp("site")
    (command,) = re.findall(
        r"^ *python (-m sphinx -W .+)$", (REPOSITORY / "CONTRIBUTING.md").read_text(encoding="utf-8"), re.MULTILINE
    )
    words = command.replace("build/site", str(folder)).split()
    build = [sys.executable, *words[:2], "-D", "nb_execution_mode=off", *words[2:]]
    run = subprocess.run(build, cwd=REPOSITORY, capture_output=True, text=True, check=False)
    assert run.returncode == 0, run.stderr
    return folder


def test_no_link_is_broken_and_no_page_loads_from_elsewhere_or_names_the_machine(site: Path) -> None:
    assert list(broken_links(site)) == []
    assert loaded_from_elsewhere(site) == []
    assert [page for page in site.rglob("*.html") if str(REPOSITORY) in page.read_text(encoding="utf-8")] == []


@pytest.mark.rendering
@pytest.mark.parametrize("notebook", NOTEBOOKS, ids=lambda path: path.stem)
def test_a_notebook_runs_and_draws(notebook: Path) -> None:
    """Of few and short episodes, in this process; the site is built with the kernel that readers have."""
    import matplotlib.pyplot as plt

    cells = [cell for cell in json.loads(notebook.read_text(encoding="utf-8"))["cells"] if cell["cell_type"] == "code"]
    assert not any(cell["outputs"] for cell in cells)
    names: dict[str, object] = {}
    for cell in cells:
        exec(compile("".join(cell["source"]).replace(LONG, SHORT), notebook.name, "exec"), names)
    assert plt.get_fignums()
    plt.close("all")


def test_every_public_name_has_its_entry(site: Path) -> None:
    for module in (quad_env, policies):
        ids = Page(site / "docs" / "api" / f"{module.__name__}.html").ids
        documented = {name for name in module.__all__ if f"{module.__name__}.{name}" in ids}
        missing = {name for name in module.__all__ if callable(getattr(module, name))} - documented
        assert missing == set()


def test_code_in_a_docstring_is_shown_line_by_line(site: Path) -> None:
    text = (site / "docs" / "api" / "policies.html").read_text(encoding="utf-8")
    shown = [re.sub(r"<.*?>", "", block) for block in re.findall(r"<pre>.*?</pre>", text, re.DOTALL)]
    assert any(re.search(r"^policy\.reset\(num_envs=n\)$", block, re.MULTILINE) for block in shown)


def test_every_formula_is_drawn(site: Path) -> None:
    source = re.sub(
        r"```.*?```", "", (REPOSITORY / "docs" / "mathematics.md").read_text(encoding="utf-8"), flags=re.DOTALL
    )
    formulas = re.findall(r"\$\$.+?\$\$|\$[^$]+\$", source)
    text = (site / "docs" / "mathematics.html").read_text(encoding="utf-8")
    assert len(formulas) > 50
    assert text.count("<math ") == len(formulas)
    assert "$" not in re.sub(r"<(script|pre).*?</\1>", "", text, flags=re.DOTALL)


def test_every_example_is_shown(site: Path) -> None:
    text = (site / "docs" / "examples.html").read_text(encoding="utf-8")
    files = [path for path in (REPOSITORY / "examples").rglob("*.py") if not path.name.startswith("_")]
    assert files
    for path in files:
        assert f"<h2>{path.relative_to(REPOSITORY).as_posix()}<" in text


def test_the_check_of_links_sees_a_missing_file_a_missing_place_and_a_foreign_script(tmp_path: Path) -> None:
    (tmp_path / "there.html").write_text('<h1 id="here">There</h1>', encoding="utf-8")
    good = '<a href="there.html#here">1</a><a href="#top" id="top">2</a><a href="https://example.org/x">3</a>'
    (tmp_path / "page.html").write_text(good, encoding="utf-8")
    assert list(broken_links(tmp_path)) == []
    assert loaded_from_elsewhere(tmp_path) == []
    bad = '<a href="gone.html">1</a><a href="there.html#gone">2</a><img src="gone.png"><script src="//a.org/x.js">'
    (tmp_path / "page.html").write_text(bad, encoding="utf-8")
    found = ["gone.html", "there.html#gone", "gone.png"]
    assert list(broken_links(tmp_path)) == [f"page.html: {link}" for link in found]
    assert loaded_from_elsewhere(tmp_path) == ["//a.org/x.js"]
