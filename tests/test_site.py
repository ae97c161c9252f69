"""The documentation site builds without a warning (such as a broken link) and without a network; its notebooks run."""

import json
import re
import subprocess
import sys
from pathlib import Path

import pytest

import policies
import quad_env

REPOSITORY = Path(__file__).parents[1]
NOTEBOOKS = sorted((REPOSITORY / "docs" / "notebooks").glob("*.ipynb"))
LONG, SHORT = '"--episodes", "16"', '"--episodes", "2", "--threads", "1"'
"""Text of a notebook, and its replacement."""


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return the site, built by the command in CONTRIBUTING.md in another folder, without the notebooks.

    A warning fails.
    """
    folder = tmp_path_factory.mktemp("site")
    (command,) = re.findall(
        r"^ *python (-m sphinx -W .+)$", (REPOSITORY / "CONTRIBUTING.md").read_text(encoding="utf-8"), re.MULTILINE
    )
    words = command.replace("build/site", str(folder)).split()
    build = [sys.executable, *words[:2], "-D", "nb_execution_mode=off", *words[2:]]
    run = subprocess.run(build, cwd=REPOSITORY, capture_output=True, text=True, check=False)
    assert run.returncode == 0, run.stderr
    return folder


def test_no_page_loads_from_elsewhere_or_names_the_machine(site: Path) -> None:
    pages = {path.relative_to(site).as_posix(): path.read_text(encoding="utf-8") for path in site.rglob("*.html")}
    loading = re.compile(r"<(?:img|script|source)[^>]* src=\"(?:\w+:)?//|<link[^>]* href=\"(?:\w+:)?//")
    assert len(pages) > 40
    assert [name for name, text in pages.items() if loading.search(text) or str(REPOSITORY) in text] == []


@pytest.mark.rendering
@pytest.mark.parametrize("notebook", NOTEBOOKS, ids=lambda path: path.stem)
def test_a_notebook_runs_and_draws(notebook: Path) -> None:
    """Episodes are few and short, in this process; the site uses the kernel that readers have."""
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
        text = (site / "docs" / "api" / f"{module.__name__}.html").read_text(encoding="utf-8")
        documented = {name for name in module.__all__ if f'id="{module.__name__}.{name}"' in text}
        missing = {name for name in module.__all__ if callable(getattr(module, name))} - documented
        assert missing == set()


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
