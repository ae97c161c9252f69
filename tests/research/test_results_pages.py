"""README, pages, CSV files and figures contain the numbers of results.json."""

import csv
import json

import pytest

from evaluate.commands.options import DEFAULT_POLICIES
from evaluate.rollouts.battery import BATTERIES
from policies import summary
from quad_env.robots.simple_quad import SIMPLE_QUAD
from research.__main__ import main
from tests.quad_env.robots.alike import alike

CELL = {
    "success_rate": 0.5,
    "success_rate_ci": [0.41, None],
    "velocity_error": 0.12345678,
    "velocity_error_ci": [0.11, 0.14],
    "outcomes": {"succeeded": 64},
}
SCORE = {"policy": "trot", "score": 0.471, "ci": [0.432, 0.534], "axes": {"flat": [1.0], "push": [0.8, 0.2]}}
SCORE |= {"difference": 0.0, "difference_ci": [0.0, 0.0], "p_value": 1.0}
WORSE = SCORE | {"policy": "stand", "score": 0.1, "difference": -0.371, "difference_ci": [-0.5, None]}
POINT = {"axis": "push", "unit": "N·s", "policy": "trot", "severity50": 48.2, "ci": [45.0, None], "found": "crossed"}
FOUND = {
    "complete": True,
    "baseline": "trot",
    "scores": [SCORE, WORSE],
    "breaking_points": [POINT],
    "episodes": 128,
    "seed": 0,
    "versions": {"mujoco": "4.0.0", "python": "3.11.7", "success_rule": "success/2"},
    "policies": {"trot": {"scenarios": {"flat": CELL}}, "stand": {"scenarios": {"flat": CELL}}},
}
EMPTY = "head\n<!-- results -->\n<!-- /results -->\n<!-- robots -->\n<!-- /robots -->\n<!-- run -->\n<!-- /run -->\n"


@pytest.fixture
def folder(tmp_path, monkeypatch):
    """Return a folder with a README and a page that have all places, as the working folder."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "docs" / "results").mkdir(parents=True)
    for name in ("README.md", "docs/page.md"):
        (tmp_path / name).write_text(EMPTY, encoding="utf-8")
    return tmp_path


def evaluation(folder, found=FOUND, name="run") -> str:
    (folder / name).mkdir(exist_ok=True)
    path = folder / name / "results.json"
    path.write_text(found if isinstance(found, str) else json.dumps(found), encoding="utf-8")
    return str(path)


def readme(folder, found=FOUND, *options) -> str:
    """Return the README after the command."""
    assert main(["readme", evaluation(folder, found), "--picture", "docs/results/run.png", *options]) == 0
    return (folder / "README.md").read_text(encoding="utf-8")


def page(folder, found=FOUND) -> str:
    """Return the page after the command."""
    evaluation(folder, found)
    assert main(["results", "run", "--pages", "docs/page.md"]) == 0
    return (folder / "docs/page.md").read_text(encoding="utf-8")


def test_the_readme_has_policies_scores_and_figure(folder) -> None:
    text = readme(folder)
    lines = text.splitlines()
    row = f"| `trot` | {summary('trot')} | 47\u00a0% [43,\u00a053] |"
    assert lines[2:5] == ["| policy | controller | success |", "|---|---|---:|", row]
    assert lines[7] == "Success: mean over 2 axes of disturbance, 128 episodes at each severity."
    assert lines[9].endswith("](docs/results/run.png)")
    unknown = FOUND | {"scores": [SCORE | {"policy": "my.onnx"}], "policies": {"my.onnx": FOUND["policies"]["trot"]}}
    assert readme(folder, unknown).splitlines()[2:4] == ["| policy | success |", "|---|---:|"]


def test_effort_and_the_front_stand_next_to_success(folder) -> None:
    effort = {"cost_of_transport": 1.234, "step_rate": 4.0, "flight": 0.305, "duty_factor": None}
    points = [
        {"policy": name, "success": share, "success_ci": [0.1, 0.6], "cost": cost, "cost_ci": [None, None]}
        | {"dominated_by": by}
        for name, share, cost, by in (("trot", 0.47, 1.2, []), ("stand", 0.1, None, []))
    ]
    front = {"cost_on": "steady", "front": ["trot"], "points": points}
    walked = {"flat": CELL, "steady": CELL | {"effort": effort}}
    of = {"trot": {"scenarios": walked}, "mine": {"scenarios": {"flat": CELL}}, "stand": {"scenarios": {"flat": CELL}}}
    found = FOUND | {"pareto": front, "policies": of, "hardware_scores": [SCORE | {"score": 0.3}]}
    lines = readme(folder, found, "--robots", evaluation(folder, found, "go")).replace("\u00a0", " ").splitlines()
    first = lines.index("<!-- results -->")
    assert lines[first + 6].endswith("severity; effort at a steady 0.5 m/s. `mine` on flat ground alone: 50 %.")
    heads = "policy | controller | success | success with the hardware profile | "
    heads += "cost of transport | step rate, 1/s | flight, %"
    rows = [
        f"`trot` | {summary('trot')} | 47 % [43, 53] | 30 % [43, 53] | 1.23 | 4.00 | 30.5",
        f"`stand` | {summary('stand')} | 10 % [43, 53] | – | – | – | –",
    ]
    assert lines[first + 1] == f"| {heads} |"
    assert lines[first + 3 : first + 5] == [f"| {row} |" for row in rows]
    assert lines[first + 8].endswith("(docs/results/run_pareto.png)")
    assert not any("go_pareto.png" in line for line in lines)
    assert "](results/run_pareto.png)" in page(folder, found)
    assert (folder / "docs/results/run_pareto.png").read_bytes().startswith(b"\x89PNG")
    with (folder / "docs/results/run.csv").open(encoding="utf-8", newline="") as file:
        assert [row["flight"] for row in csv.DictReader(file)] == ["", "0.305", "", ""]


def test_a_page_has_scores_figure_files_and_command_at_its_place(folder) -> None:
    head, run = page(folder).replace("\u00a0", " ").split("<!-- run -->")
    assert head == EMPTY.split("<!-- run -->", maxsplit=1)[0]
    assert "| `trot` | 47.1 [43.2 … 53.4 %] | – |" in run
    assert "| `stand` | 10.0 [43.2 … 53.4 %] | −37.1 [–], p = 1.00 |" in run
    assert "](results/run.png)" in run
    assert "](results/run_scores.csv)" in run
    assert "`python -m evaluate --policies trot stand --scenarios flat --episodes 128`; MuJoCo 4.0.0" in run
    assert (folder / "docs/results/run.png").read_bytes().startswith(b"\x89PNG")


def test_files_have_a_row_for_each_entry_and_intervals_by_their_ends(folder) -> None:
    page(folder)
    rows = {}
    for ending in ("", "_scores", "_breaking_points"):
        with (folder / f"docs/results/run{ending}.csv").open(encoding="utf-8", newline="") as file:
            rows[ending] = list(csv.DictReader(file))
    ends = {"success_rate_low": "0.41", "success_rate_high": "", "velocity_error_low": "0.11"}
    row = {"scenario": "flat", "policy": "trot", "success_rate": "0.5", "velocity_error": "0.123457"}
    assert rows[""][0] == row | ends | {"velocity_error_high": "0.14"}
    assert [each["policy"] for each in rows["_scores"]] == ["trot", "stand"]
    assert rows["_scores"][1]["difference_high"] == ""
    assert (rows["_breaking_points"][0]["low"], rows["_breaking_points"][0]["high"]) == ("45", "")


def test_the_command_and_versions_that_made_the_results_are_named(folder) -> None:
    same = "python -m evaluate --policies trot stand --scenarios flat"
    hardware = {"hardware": {"actuator": "motor", "sensors": "truth"}}
    for changes, words in (
        ({"provenance": hardware}, f"{same} --episodes 128 --actuator motor`; MuJoCo 4.0.0, Python 3.11.7."),
        ({"seed": 3, "episodes": 20}, f"{same} --seed 3`;"),
        ({"versions": {"mujoco": "3", "python": "3"}}, "Python 3; success by the older rule success/1."),
    ):
        assert words in readme(folder, FOUND | changes)


@pytest.mark.parametrize(
    ("battery", "episodes", "words"),
    [
        ("default", 24, " --full"),
        ("default", 20, " --full --episodes 20"),
        ("quick", 20, " --episodes 20"),
        ("full", 20, " --scenarios full"),
    ],
)
def test_a_battery_is_called_by_its_name(battery, episodes, words, folder) -> None:
    cells = dict.fromkeys((scenario.name for scenario in BATTERIES[battery](SIMPLE_QUAD)), CELL)
    of = {policy: {"scenarios": cells} for policy in DEFAULT_POLICIES}
    assert f"\n`python -m evaluate{words}`;" in readme(folder, FOUND | {"policies": of, "episodes": episodes})


def test_scores_with_the_hardware_profile_stand_next_to_those_without_and_policies_without_any_in_a_sentence(
    folder,
) -> None:
    alone = FOUND["policies"] | {"article": {"scenarios": {"flat": CELL}}}
    both = FOUND | {"hardware_scores": [WORSE | {"score": 0.2, "axes": {"push": [0.2]}}], "policies": alone}
    text = readme(folder, both, "--robots", evaluation(folder, both, "one")).replace("\u00a0", " ")
    assert "| policy | controller | success | success with the hardware profile |" in text
    assert f"| `stand` | {summary('stand')} | 10 % [43, 53] | 20 % [43, 53] |" in text
    assert "`article` on flat ground alone: 50 %." in text
    assert "| simple_quad, hardware profile | – | 20 %" in text
    run = page(folder, both).replace("\u00a0", " ")
    assert "| hardware score, % | minus `trot`, % points |" in run
    assert "| `trot` | 47.1 [43.2 … 53.4 %] | – | – | – |" in run
    assert "| 20.0 [43.2 … 53.4 %] | −37.1 [–], p = 1.00 |" in run
    assert "](results/run_hardware_scores.csv)" in run
    assert "stand,0.2," in (folder / "docs/results/run_hardware_scores.csv").read_text(encoding="utf-8")


def test_other_robots_have_a_row_each(folder) -> None:
    def of_robot(robot: str, *policies: str) -> dict:
        scores = [SCORE | {"policy": policy} for policy in policies]
        return FOUND | {"scores": scores, "provenance": {"hardware": {"robot": robot}}}

    alike(folder)
    one = evaluation(folder, of_robot("simple_quad", "trot", "residual"), "one")
    other = evaluation(folder, of_robot(str(folder / "alike.xml"), "residual", "mpc_wbc"), "other")
    table = readme(folder, FOUND, "--robots", one, other).split("<!-- robots -->\n")[1].splitlines()
    assert table[0] == "| robot | `residual` |"  # the common policy of all robots
    assert table[2] == "| simple_quad, 14.2 kg on legs of 0.60 m | 47\u00a0% [43,\u00a053] |"
    assert table[3].startswith("| alike, 1.4 kg on legs of 0.24 m | ")


@pytest.mark.parametrize(
    ("content", "words"),
    [
        (json.dumps(FOUND | {"complete": False}), "--resume"),
        (json.dumps(FOUND | {"scores": []}), "no scores"),
        *((text, "results.json") for text in ("{", "null", json.dumps(FOUND | {"versions": None}))),
        (json.dumps({"complete": True, "versions": FOUND["versions"]}), "results.json"),
    ],
)
def test_what_is_no_finished_evaluation_is_refused(content, words, folder, refused) -> None:
    path = evaluation(folder, content)
    for line in (["readme", path], ["results", "run", "--pages", "docs/page.md"]):
        assert words in refused(main, *line)
    for name in ("README.md", "docs/page.md"):
        assert (folder / name).read_text(encoding="utf-8") == EMPTY
    assert not list(folder.glob("docs/results/*"))
