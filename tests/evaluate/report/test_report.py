"""The file report.html: offline, complete in one file, and readable in a browser on a desktop and on a phone."""

import dataclasses
import json
import re
from datetime import UTC, date, datetime
from html import escape, unescape
from html.parser import HTMLParser

import numpy as np
import pytest

from evaluate.analysis.results import Results, analyse, results_to_json
from evaluate.measures.outcomes import OUTCOMES
from evaluate.report.page import render
from policies import summary
from quad_env.cli.format import join_names
from quad_env.scenarios.axes import AXES
from tests.live.view.test_browser import CHROMIUM, QUIET


@pytest.fixture(scope="session")
def page(run) -> str:
    return (run.folder / "report.html").read_text(encoding="utf-8")


class Outline(HTMLParser):
    """References and tags of an HTML page."""

    def __init__(self, page: str) -> None:
        super().__init__()
        self.references: list[str] = []
        self.tags: list[str] = []
        self.feed(page)

    def handle_starttag(self, tag, attrs) -> None:
        self.tags.append(tag)
        self.references += [value for name, value in attrs if name in ("src", "href", "srcset", "data")]


def test_the_page_needs_nothing_but_itself(page) -> None:
    outline = Outline(page)
    assert outline.references
    assert all(re.match(r"data:image/(svg\+xml|webp);base64,|#", reference) for reference in outline.references)
    assert "script" not in outline.tags
    assert not re.search(r"url\(|@import", page.split("</style>")[0])


def test_the_answer_comes_first_and_the_sections_in_their_order(page, four, run) -> None:
    """Before any other table the report has the best policy, the ranking and its front, and the weak scenarios."""
    ranking = run.results["ranking"]
    best, second = (each["policy"] for each in ranking["places"][:2])
    head = unescape(re.findall("<h1>(.*?)</h1>", page)[0])
    assert best in head
    assert second in head
    sections = [name for name in re.findall(r'<section id="([^"]+)">', four.page) if not name.startswith("axis-")]
    assert sections == [
        "ranking", "best-and-worst", "worst-and-most-typical-failures", "effort", "success-on-every-axis",
        "breaking-points", "policies", "how-it-was-measured",
    ]  # fmt: skip
    assert page.index(">score<") < page.index("<img") < page.index('class="verdicts"') < page.index("worst on")
    policies_section = page.split('<section id="policies">')[1].split("</section>")[0]
    assert all(f": {escape(summary(name))}</li>" in policies_section for name in ("document", "stand", "trot"))


def test_each_two_neighbours_have_their_line(four) -> None:
    section = four.page.split('<section id="ranking">')[1].split("</section>")[0]
    said = [unescape(re.sub("<.*?>", "", line)) for line in re.findall(r"<li.*?>(.*?)</li>", section)]
    neighbours = four.results["ranking"]["neighbours"]
    assert len(said) == len(neighbours) == 3
    for line, each in zip(said, neighbours, strict=True):
        assert line.startswith(f"{each['better']} {'beats' if each['p_value_holm'] < 0.05 else 'and'} {each['worse']} ")
        assert f"{100 * each['difference']:.1f} points" in line
    assert "paired by episode" in section


def test_the_contents_lead_to_every_section(page) -> None:
    sections = re.findall(r'<section id="([^"]+)">', page)
    first, axes = re.findall(r"<nav.*?</nav>", page, re.DOTALL)
    assert {*re.findall(r'href="#([^"]+)"', first + axes)} == {*sections}
    assert len(set(sections)) == len(sections) == page.count("<section")
    assert "axis-" not in first


def test_p_values_are_of_success_alone(four) -> None:
    """Falls and errors have intervals; all p-values of the page belong to one family."""
    rows = re.findall(r"<tr>(<td>[^<]*(?:<wbr>[^<]*)* − .*?)</tr>", four.page)
    assert len(rows) > 10
    for row in rows:
        assert ["p\u00a0" in cell for cell in re.findall("<td.*?</td>", row)[1:]] == [False, True]


def test_what_results_under_pushes_depend_on_is_said_where_they_are(page) -> None:
    parts = dict(zip(re.findall(r'<section id="([^"]+)">', page), page.split("<section ")[1:], strict=True))
    said = {name for name, part in parts.items() if escape(AXES["push"].note) in part}
    assert said == {"axis-push"}


def test_the_page_names_its_command_and_day(run, page) -> None:
    begun = json.loads((run.folder / "manifest.json").read_text(encoding="utf-8"))["date"]
    assert date.fromisoformat(begun) <= datetime.now(UTC).date()
    words = "python -m evaluate --policies document stand trot --scenarios flat push --episodes 5 --seed 3"
    assert f"Made by <code>{words}</code>, begun on {begun}." in page


def test_the_front_is_named_below_its_picture(four) -> None:
    section = four.page.split('<section id="ranking">')[1].split("</section>")[0]
    front = four.results["pareto"]["front"]
    assert f"Cost of transport on flat. On the Pareto front (filled marks, line): {join_names(front)}." in section


def test_every_plot_says_what_it_shows(page) -> None:
    plots = [image for image in re.findall(r"<img [^>]*>", page) if "image/svg" in image]
    assert len(plots) == 5  # the front, the causes of each policy, the heat map: no axis has several levels
    assert all(re.search(r'alt="[^"]{10,}"', image) for image in plots)


def odd_one(made: Results) -> Results:
    """Return a partial run on motors: the policy `other` ran only on flat and rough, and raised in three episodes."""
    cells = []
    for cell in made.cells:
        if cell.policy == "other" and cell.scenario.name in ("flat", "rough"):
            failure = np.full(cell.episodes, None, dtype=object)
            failure[cell.scenario.name == "flat" : 2] = "raised ValueError: a_b <c>\nsecond line"
            cells.append(dataclasses.replace(cell, failure=failure))
        elif cell.policy == "trot" and cell.scenario.name != "rough":
            cells.append(cell)
    provenance = {"versions": {}, "hardware": {"actuator": "motor", "sensors": "typical"}}
    return analyse(cells, seed=0, episodes=40, complete=False, provenance=provenance)


@pytest.fixture(scope="module")
def odd(made) -> tuple[Results, str]:
    """Return the results of the partial run and its page."""
    results = odd_one(made)
    return results, render(results)


def test_what_a_reader_has_to_know_first_stands_at_the_top(odd, page) -> None:
    results, text = odd
    error = {"policy": "other", "failed": 3, "episodes": 80, "first": "raised ValueError: a_b <c> second line"}
    assert results_to_json(results)["policy_errors"] == [error]
    top = text[: text.index("<section")].replace("\u00a0", " ")
    for said in (
        "Interrupted: this page shows the part",
        escape("other failed in 3 of 80 episodes; in the first it raised ValueError: a_b <c> second line"),
        "Motors: motor; sensors: typical.",
    ):
        assert said in top
    assert not re.search("Interrupted|failed in|Motors:", page[: page.index("<section")])


def test_outcomes_are_those_of_the_rule(page, run) -> None:
    assert set(run.results["policies"]["trot"]["scenarios"]["flat"]["outcomes"]) == set(OUTCOMES)
    assert "rule success/2" in page.split("Every measure: unit")[-1]


def test_a_policy_stands_only_where_it_ran(odd) -> None:
    """The policy `other` did not run on the pushes, and the trot did not run on rough."""
    sections = dict(zip(re.findall(r'<section id="([^"]+)">', odd[1]), odd[1].split("<section ")[1:], strict=True))
    assert "</span>other" not in sections["axis-push"]
    assert "</span>other" in sections["axis-flat"]
    assert "</span>trot" not in sections["axis-rough"]


@pytest.mark.skipif(CHROMIUM is None, reason="needs a browser: apt-get install chromium")
@pytest.mark.parametrize("width", [1280, 390], ids=["desk", "phone"])
def test_a_browser_opens_every_fold_and_nothing_runs_out_of_the_page(page, tmp_path, width: int) -> None:
    from playwright.sync_api import sync_playwright

    tmp_path.joinpath("report.html").write_text(page, encoding="utf-8")
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=CHROMIUM, args=[*QUIET])
        shown, complaints = browser.new_page(viewport={"width": width, "height": 900}), []
        shown.on("console", lambda message: complaints.append(message.text))
        shown.on("requestfailed", lambda request: complaints.append(request.url))
        shown.goto(tmp_path.joinpath("report.html").as_uri())
        folded = shown.evaluate("document.documentElement.scrollWidth")
        folds = shown.locator("summary").all()
        for fold in folds:
            if fold.evaluate("each => !each.parentElement.open"):
                fold.click()
        opened = shown.locator("details[open]").count()
        images = shown.evaluate("[...document.images].map(one => one.naturalWidth * one.getBoundingClientRect().width)")
        tables = "[...document.querySelectorAll('table')].map(one => one.scrollWidth - one.parentElement.clientWidth)"
        beyond, unfolded = shown.evaluate(tables), shown.evaluate("document.documentElement.scrollWidth")
        browser.close()
    assert complaints == []
    assert opened == len(folds) > 0
    assert min(images) > 0
    assert max(folded, unfolded) <= width
    assert width == 390 or max(beyond) <= 1
