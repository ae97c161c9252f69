"""report.html: one offline file that a real browser shows, on a desk and on a phone."""

import re
import shutil
import subprocess
from html.parser import HTMLParser

import pytest

from evaluate.format import interval, listed, number, p_value, percent, percent_interval, points
from evaluate.verdict import headline

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
    assert all(reference.startswith("data:image/svg+xml;base64,") for reference in outline.references)
    assert "script" not in outline.tags
    assert not re.search(r"url\(|@import", page.split("</style>")[0])


def test_the_outcome_in_words_comes_before_every_table_and_plot(page) -> None:
    assert 0 < page.index("Outcome") < page.index("<table") < page.index("<img")
    assert page.index("Smallest velocity error") < page.index("<table")


def test_every_policy_and_scenario_is_on_the_page(page) -> None:
    text = " ".join(Outline(page).words)
    for word in ("document", "stand", "trot", "flat", "push", "baseline", "mujoco"):
        assert word in text
    assert "5 of 5" in text.replace("\u00a0", " ")


def test_every_plot_says_what_it_shows(page) -> None:
    images = re.findall(r"<img [^>]*>", page)
    assert len(images) >= 2 * 2 + 2 * 2
    assert all(re.search(r'alt="[^"]{10,}"', image) for image in images)


def test_names_are_escaped(page) -> None:
    from evaluate.report import _name

    assert _name("<b>&") == "&lt;b&gt;&amp;"


LOOK = """<script>
window.addEventListener("load", () => {
  const images = [...document.images];
  document.body.dataset.shown = images.filter((image) => image.naturalWidth > 0 && image.offsetWidth > 0).length;
  document.body.dataset.images = images.length;
  document.body.dataset.overflow = document.documentElement.scrollWidth - window.innerWidth;
});
</script>"""


@pytest.mark.parametrize("width", [1200, 500])
def test_a_browser_shows_every_plot_and_nothing_runs_out_of_the_page(page, tmp_path, width) -> None:
    browser = next(filter(None, map(shutil.which, BROWSERS)), None)
    if browser is None:
        pytest.skip(f"no browser: looked for {', '.join(BROWSERS)}")
    copy = tmp_path / "report.html"
    copy.write_text(page + LOOK, encoding="utf-8")
    command = [browser, "--headless=new", "--no-sandbox", "--disable-gpu", f"--user-data-dir={tmp_path / 'profile'}"]
    command += [f"--window-size={width},900", "--host-resolver-rules=MAP * ~NOTFOUND", "--dump-dom", copy.as_uri()]
    finished = subprocess.run(command, capture_output=True, text=True, timeout=120, check=False)
    body = re.search(r"<body[^>]*>", finished.stdout)
    if body is None:
        pytest.skip(f"the browser does not run here: {finished.stderr.strip()[-200:]}")
    seen = dict(re.findall(r'data-(\w+)="(-?\d+)"', body.group()))
    assert int(seen["images"]) > 0
    assert seen["shown"] == seen["images"]
    assert int(seen["overflow"]) <= 0


def test_figures_read_as_people_write_them() -> None:
    assert number(-0.12345) == "−0.123"
    assert number(-0.0001) == "0.000"
    assert number(float("nan")) == "–"
    assert interval((-0.1, 0.25)).replace("\u00a0", " ") == "−0.100 … 0.250"
    assert interval((float("nan"), 1.0)) == "–"
    assert [percent(x).replace("\u00a0", " ") for x in (0.0, 0.031, 0.84, 1.0)] == ["0 %", "3.1 %", "84 %", "100 %"]
    assert percent_interval((0.0, 0.057)).replace("\u00a0", " ") == "0.0 … 5.7 %"
    assert points(-0.25) == "−25.0"
    assert [p_value(x).replace("\u00a0", " ") for x in (0.0001, 0.0262, 1.0)] == ["p < 0.001", "p = 0.026", "p = 1.00"]
    assert listed(["a"]) == "a"
    assert listed(["a", "b", "c"]) == "a, b and c"


def test_the_headline_names_the_smallest_error_and_the_fewest_falls(run, page) -> None:
    cells = {name: entry["scenarios"]["flat"] for name, entry in run.results["policies"].items()}
    best = min(cells, key=lambda name: cells[name]["velocity_error"])
    sentence = re.search(r"Smallest velocity error: ([^<]*)", page)
    assert sentence is not None
    assert sentence.group(1).startswith(best)
    assert headline.__doc__
