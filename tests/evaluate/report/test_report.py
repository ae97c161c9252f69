"""report.html: one offline file that a real browser shows, on a desk and on a phone."""

import dataclasses
import json
import re
import shutil
import subprocess
from datetime import UTC, date, datetime
from html import escape, unescape
from html.parser import HTMLParser
from pathlib import Path

import pytest

from evaluate.analysis.results import analyse
from evaluate.report.page import render
from evaluate.report.sections.worst import worst
from policies import summary

BROWSERS = ("chromium", "chromium-browser", "google-chrome", "chrome")


@pytest.fixture(scope="session")
def page(run) -> str:
    return (run.folder / "report.html").read_text(encoding="utf-8")


class Outline(HTMLParser):
    """What a page refers to, and its text."""

    def __init__(self, page: str) -> None:
        super().__init__()
        self.references: list[str] = []
        self.tags: list[str] = []
        self.words: list[str] = []
        self.feed(page)

    def handle_starttag(self, tag, attrs) -> None:
        self.tags.append(tag)
        self.references += [value for name, value in attrs if name in ("src", "href", "srcset", "data")]

    def handle_data(self, data) -> None:
        self.words.append(data)


def test_the_page_needs_nothing_but_itself(page) -> None:
    outline = Outline(page)
    assert outline.references
    assert all(re.match(r"data:image/(svg\+xml|webp);base64,|#", reference) for reference in outline.references)
    assert "script" not in outline.tags
    assert not re.search(r"url\(|@import", page.split("</style>")[0])


def test_the_outcome_in_words_comes_before_every_table_and_plot(page) -> None:
    first = min(page.index("<table"), page.index("<img"))
    assert 0 < page.index("Outcome") < page.index("document against trot") < first


def test_what_each_policy_is_stands_before_its_figures(page) -> None:
    legend = page[page.index('<ul class="legend">') : page.index("Outcome")]
    assert all(f": {escape(summary(name))}</li>" in legend for name in ("document", "stand", "trot"))


def test_the_contents_lead_to_every_section(page) -> None:
    sections = re.findall(r'<section id="([^"]+)">', page)
    contents = page[page.index("<nav") : page.index("</nav>")]
    assert re.findall(r'href="#([^"]+)"', contents) == sections
    assert len(set(sections)) == len(sections) == page.count("<section")
    assert {"outcome", "axis-push", "how-it-was-measured"} <= set(sections)


def test_the_page_names_its_command_and_day(run, page) -> None:
    begun = json.loads((run.folder / "manifest.json").read_text(encoding="utf-8"))["date"]
    assert date.fromisoformat(begun) <= datetime.now(UTC).date()
    words = "python -m evaluate --policies document stand trot --scenarios flat push --episodes 5 --seed 3"
    assert f"Made by <code>{words}</code>, begun on {begun}." in page


def test_a_policy_stands_only_where_it_ran(made) -> None:
    """The other policy on flat ground alone: it has no row in the tables of push and rough, and the page says so."""
    cells = tuple(c for c in made.cells if (c.policy, c.scenario.name) in {("other", "flat")} or c.policy == "trot")
    page = render(analyse(cells, seed=0, episodes=40, complete=True), Path())
    assert "40 episodes of each policy on each of 6 scenarios, of other on flat alone: flat, push and rough." in page
    sections = dict(zip(re.findall(r'<section id="([^"]+)">', page), page.split("<section ")[1:], strict=True))
    assert {name for name, text in sections.items() if "</span>other" in text} == {
        "axis-flat", "worst-episodes"
    }  # fmt: skip


def test_every_plot_says_what_it_shows(page) -> None:
    images = re.findall(r"<img [^>]*>", page)
    plots = [image for image in images if "image/svg" in image]
    # Success; bars and pairs of each scenario, pushes and gaits of the two policies that stay upright, responses.
    assert len(plots) == 2 + 2 * (3 + 1) + 2 + 2 + 3
    assert all(re.search(r'alt="[^"]{10,}"', image) for image in images)


def test_the_worst_falls_come_first_with_the_command_that_replays_them(made) -> None:
    """Other falls least often on push:3 (5 %), so its falls there surprise the most; then on push:5 (43 %)."""
    assert [(cell.scenario.name, episode) for cell, episode in worst(made, "other")][:3] == [
        ("push:3", 0),
        ("push:3", 1),
        ("push:5", 0),
    ]
    page = unescape(render(made, Path("some where")))
    assert "python -m evaluate replay 'some where' 0 --policy other --scenario push:3" in page


def test_without_falls_the_largest_errors_are_the_worst(made) -> None:
    mild = dataclasses.replace(made, cells=tuple(c for c in made.cells if c.scenario.name in ("flat", "push:1")))
    found = worst(mild, "trot")
    assert [episode for _, episode in found] == [39, 39, 38, 38, 37]
    assert {cell.fall_reason[episode] for cell, episode in found} == {None}


FRAME = """<!DOCTYPE html><body><iframe src="report.html" style="width: {width}px; height: 900px; border: 0"></iframe>
<script>
addEventListener("load", () => {{
  const shown = document.querySelector("iframe").contentDocument, root = shown.documentElement, seen = {{}};
  seen.overflow = root.scrollWidth - {width};
  for (const summary of shown.querySelectorAll("summary")) if (!summary.parentElement.open) summary.click();
  setTimeout(() => {{
    const images = [...shown.images];
    seen.images = images.length;
    seen.visible = images.filter((image) => image.naturalWidth > 0 && image.getBoundingClientRect().width > 0).length;
    seen.folds = shown.querySelectorAll("details").length;
    seen.opened = shown.querySelectorAll("details[open]").length;
    seen.overflowUnfolded = root.scrollWidth - {width};
    const tables = [...shown.querySelectorAll("table")];
    seen.cutTables = tables.filter((table) => table.scrollWidth > table.parentElement.clientWidth + 1).length;
    document.body.dataset.seen = JSON.stringify(seen);
  }}, 500);
}});
</script>"""
"""A page that looks at the report in a frame of that width: a browser's window itself may not be as narrow."""


@pytest.mark.parametrize("width", [1280, 390])
def test_a_browser_opens_every_fold_and_nothing_runs_out_of_the_page(page, tmp_path, width) -> None:
    browser = next(filter(None, map(shutil.which, BROWSERS)), None)
    if browser is None:
        pytest.skip(f"no browser: looked for {', '.join(BROWSERS)}")
    tmp_path.joinpath("report.html").write_text(page, encoding="utf-8")
    frame = tmp_path / "frame.html"
    frame.write_text(FRAME.format(width=width), encoding="utf-8")
    command = [browser, "--headless=new", "--no-sandbox", "--disable-gpu", f"--user-data-dir={tmp_path / 'profile'}"]
    command += ["--enable-logging=stderr", "--allow-file-access-from-files", "--virtual-time-budget=20000"]
    command += ["--window-size=1400,1000", "--host-resolver-rules=MAP * ~NOTFOUND", "--dump-dom", frame.as_uri()]
    finished = subprocess.run(command, capture_output=True, text=True, timeout=120, check=False)
    found = re.search(r'data-seen="([^"]*)"', finished.stdout)
    if found is None:
        pytest.skip(f"the browser does not run here: {finished.stderr.strip()[-200:]}")
    assert "CONSOLE" not in finished.stderr
    seen = json.loads(unescape(found.group(1)))
    assert seen["images"] > 0
    assert seen["visible"] == seen["images"]
    assert seen["opened"] == seen["folds"] > 0
    assert seen["overflow"] <= 0
    assert seen["overflowUnfolded"] <= 0
    if width > 1000:
        assert seen["cutTables"] == 0
