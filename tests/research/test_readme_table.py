"""The tables of README and docs hold the figures of results.json."""

import json

import pytest

from evaluate.__main__ import main
from evaluate.analysis.results import with_nan
from evaluate.commands.options import DEFAULT_POLICIES
from evaluate.report.results_page import every_figure, newcomers_table
from evaluate.rollouts.battery import BATTERIES
from policies import summary
from quad_env.cli.command_line import UsageError
from quad_env.robots.simple_quad import SIMPLE_QUAD
from research.pages.readme import insert
from tests.quad_env.robots.alike import alike

CELL = {
    "success_rate": 0.5,
    "success_rate_ci": [0.41, 0.59],
    "fall_rate": 0.25,
    "fall_rate_ci": [0.18, 0.33],
    "velocity_error": 0.1234,
    "velocity_error_ci": [0.11, 0.14],
    "yaw_rate_error": 0.2,
    "yaw_rate_error_ci": [0.19, 0.21],
    "mean_velocity_error": 0.05,
}
POINT = {"axis": "push", "unit": "N·s", "lowest": 20.0, "highest": 100.0, "hardest": 100.0}
POINTS = [
    POINT | {"policy": "trot", "severity50": 48.2, "ci": [45.0, None], "found": "crossed"},
    POINT | {"policy": "stand", "severity50": None, "ci": [None, None], "found": "never"},
    POINT | {"axis": "soft", "policy": "stand", "severity50": None, "ci": [None, None], "found": "always", "unit": "m"},
]
NOISE = {
    "axis": "noise",
    "scenario": "noise:4",
    "severity": 0.8,
    "unit": "rad/s",
    "felt": True,
    "undisturbed_success_rate": 1.0,
    "success": -0.25,
    "success_ci": [-0.4, -0.1],
    "success_p_value": 0.001,
    "velocity_error": 0.5,
    "velocity_error_ci": [0.4, None],
    "velocity_error_p_value": 0.001,
}
FOUND = {
    "complete": True,
    "breaking_points": [],
    "sensitivities": [],
    "episodes": 128,
    "seed": 0,
    "versions": {"mujoco": "4.0.0", "python": "3.11.7"},
    "policies": {"trot": {"scenarios": {"flat": CELL}}, "stand": {"scenarios": {"flat": CELL | {"fall_rate": 0.0}}}},
}

TODAY = {"success_rule": "success/2"}


def written(tmp_path, found, more=None) -> tuple[str, str]:
    """README and page after the command."""
    places = "<!-- results -->\n<!-- /results -->\n<!-- more -->\n<!-- /more -->\n"
    files = [tmp_path / name for name in ("README.md", "page.md", "results.json", "more.json")]
    for file, text in zip(files, (places, places, json.dumps(found), json.dumps(more)), strict=True):
        file.write_text(text, encoding="utf-8")
    readme, page, results, others = map(str, files)
    arguments = ["readme", results, "--readme", readme, "--page", page, *(["--more", others] if more else [])]
    assert main(arguments) == 0
    return files[0].read_text(encoding="utf-8"), files[1].read_text(encoding="utf-8")


def test_figures_by_the_older_rule_of_success_say_so(tmp_path) -> None:
    old, new = (written(tmp_path, FOUND | {"versions": FOUND["versions"] | more}) for more in ({}, TODAY))
    assert all("Python 3.11.7; success by the older rule success/1." in text for text in old)
    assert not any("success/" in text for text in new)


def test_a_page_alone_leaves_the_readme_and_its_picture_as_they_are(tmp_path, monkeypatch) -> None:
    monkeypatch.chdir(tmp_path)
    for name in ("README.md", "page.md"):
        (tmp_path / name).write_text("<!-- results -->\n<!-- /results -->\n", encoding="utf-8")
    (tmp_path / "results.json").write_text(json.dumps(FOUND), encoding="utf-8")
    assert main(["readme", "results.json", "--readme", "None", "--page", "page.md"]) == 0
    assert "| flat | `trot` |" in (tmp_path / "page.md").read_text(encoding="utf-8")
    assert (tmp_path / "README.md").read_text(encoding="utf-8") == "<!-- results -->\n<!-- /results -->\n"
    assert not list(tmp_path.glob("*.png"))


def test_every_figure_has_a_row_for_each_policy_on_each_scenario() -> None:
    rows = [line for line in every_figure(FOUND) if line.startswith("| flat")]
    assert [row.split("|")[2].strip() for row in rows] == ["`trot`", "`stand`"]
    assert "25" in rows[0]
    assert "0.123" in rows[0]


def test_a_policy_that_walked_on_flat_ground_alone_has_no_other_row() -> None:
    found = FOUND | {
        "policies": {"trot": {"scenarios": {"flat": CELL, "push": CELL}}, "stand": {"scenarios": {"flat": CELL}}}
    }
    assert [line.split("|")[1:3] for line in every_figure(found)[4:]] == [
        [" flat ", " `trot` "],
        [" flat ", " `stand` "],
        [" push ", " `trot` "],
    ]
    table = newcomers_table(found)
    assert [line for line in table if line.startswith("| ")] == [
        "| condition | `trot` |",
        "| flat ground | 50\u00a0% (25\u00a0%) |",
        "| push at 35\u00a0N·s | 50\u00a0% (25\u00a0%) |",
    ]
    assert table[-1] == "On flat ground alone: `stand` 50\u00a0% (25\u00a0%)."


def test_the_headline_counts_scenarios_by_the_most_success() -> None:
    better, worse = CELL, CELL | {"success_rate": 0.2}
    scenarios = {"trot": [better, worse, worse], "stand": [worse, better, better], "walk": [worse, worse, worse]}
    names = ("flat", "push", "rough")
    policies = {name: {"scenarios": dict(zip(names, cells, strict=True))} for name, cells in scenarios.items()}
    first = newcomers_table(FOUND | {"policies": policies})[0]
    assert "3 scenarios of 128 episodes" in first
    assert "`stand` succeeds most often, or as often as the best, on 2, `trot` on 1." in first


def test_breaking_points_are_a_table_of_axes_and_policies() -> None:
    text = "\n".join(every_figure(with_nan(FOUND | {"breaking_points": POINTS}))).replace("\u00a0", " ")
    assert "| push, N·s | 48.2 N·s [45, > 100] | none up to 100 N·s |" in text
    assert "| soft, m | – | already at 20 m |" in text
    assert "half of the episodes fall" not in "\n".join(every_figure(FOUND))


def test_what_disturbances_do_is_a_table_of_axes_and_policies() -> None:
    both = [NOISE | {"policy": "trot", "felt": False}, NOISE | {"policy": "stand"}]
    text = "\n".join(every_figure(with_nan(FOUND | {"sensitivities": both}))).replace("\u00a0", " ")
    assert "| noise, 0.8 rad/s | the same to the bit | −25 points, +0.50 m/s |" in text
    assert "| disturbance |" not in "\n".join(every_figure(FOUND))


@pytest.mark.parametrize(
    ("changes", "command"),
    [
        ({}, "python -m evaluate --policies trot stand --scenarios flat --episodes 128"),
        (
            {"provenance": {"hardware": {"actuator": "motor", "sensors": "truth"}}},
            "python -m evaluate --policies trot stand --scenarios flat --episodes 128 --actuator motor",
        ),
        ({"seed": 3, "episodes": 24}, "python -m evaluate --policies trot stand --scenarios flat --seed 3"),
    ],
)
def test_the_command_that_makes_the_tables_is_below_them(changes, command, tmp_path) -> None:
    for text in written(tmp_path, FOUND | changes):
        assert f"\n`{command}`; MuJoCo" in text


def test_what_the_policies_are_stands_before_their_figures_in_the_readme(tmp_path) -> None:
    readme, _ = written(tmp_path, FOUND)
    first = readme.splitlines()[1]
    assert first == f"`trot`: {summary('trot')}.<br>`stand`: {summary('stand')}."
    assert written(tmp_path, FOUND | {"policies": {"my.onnx": FOUND["policies"]["trot"]}})[0].splitlines()[1] != first


@pytest.mark.parametrize(("battery", "words"), [("default", ""), ("quick", " --scenarios quick")])
def test_a_battery_is_called_by_its_name(battery, words, tmp_path) -> None:
    cells = dict.fromkeys((scenario.name for scenario in BATTERIES[battery](SIMPLE_QUAD)), CELL)
    of = {policy: {"scenarios": cells} for policy in DEFAULT_POLICIES}
    readme, page = written(tmp_path, FOUND | {"policies": of, "episodes": 24})
    assert f"\n`python -m evaluate{words}`;" in readme
    assert f"\n`python -m evaluate{words}`;" in page


def test_further_policies_have_a_place_of_their_own(tmp_path) -> None:
    _, page = written(tmp_path, FOUND, FOUND | {"policies": {"walk": {"scenarios": {"flat": CELL}}}})
    first, second = page.split("<!-- more -->")
    assert "`trot`" in first
    assert "`walk`" not in first
    assert "`walk`" in second
    assert "`trot`" not in second


def test_a_score_has_a_picture_in_the_readme_and_a_row_on_the_page(tmp_path) -> None:
    score = {"policy": "trot", "score": 0.5, "ci": [0.4, 0.6], "axes": {"flat": [1.0], "push": [0.8, 0.2]}}
    score |= {"difference": 0.0, "difference_ci": [0.0, 0.0], "p_value": 1.0}
    other = score | {"policy": "stand", "score": 0.1, "difference": -0.4, "difference_ci": [-0.5, None]}
    (tmp_path / "docs").mkdir()
    for name in ("README.md", "docs/page.md"):
        (tmp_path / name).write_text("<!-- results -->\n<!-- /results -->\n", encoding="utf-8")
    (tmp_path / "results.json").write_text(
        json.dumps(FOUND | {"scores": [score, other], "baseline": "trot"}), encoding="utf-8"
    )
    files = {"readme": "README.md", "page": "docs/page.md", "picture": "docs/success.png"}
    words = [word for option, name in files.items() for word in (f"--{option}", str(tmp_path / name))]
    assert main(["readme", str(tmp_path / "results.json"), *words]) == 0
    assert "](docs/success.png)" in (tmp_path / "README.md").read_text(encoding="utf-8")
    assert (tmp_path / "docs/success.png").read_bytes().startswith(b"\x89PNG")
    page = (tmp_path / "docs/page.md").read_text(encoding="utf-8").replace("\u00a0", " ")
    assert "| `trot` | 50.0 [40.0 … 60.0 %] | – |" in page
    assert "| `stand` | 10.0 [40.0 … 60.0 %] | −40.0 [–], p = 1.00 |" in page


def test_only_what_is_between_the_markers_changes() -> None:
    text = "head\n<!-- results -->\nold\n<!-- /results -->\ntail\n"
    assert insert(text, ["new"]) == "head\n<!-- results -->\nnew\n<!-- /results -->\ntail\n"
    assert insert(insert(text, ["a"]), ["b"]) == insert(text, ["b"])
    with pytest.raises(UsageError, match="results"):
        insert("nothing here", ["new"])


def refused(capsys, tmp_path, content: str) -> str:
    """The one line about a results.json of that content; neither file must have changed."""
    readme, page, results = tmp_path / "README.md", tmp_path / "page.md", tmp_path / "results.json"
    for file in (readme, page):
        file.write_text("<!-- results -->\n<!-- /results -->\n", encoding="utf-8")
    results.write_text(content, encoding="utf-8")
    assert main(["readme", str(results), "--readme", str(readme), "--page", str(page)]) == 2
    assert (
        readme.read_text(encoding="utf-8")
        == page.read_text(encoding="utf-8")
        == "<!-- results -->\n<!-- /results -->\n"
    )
    error = capsys.readouterr().err
    assert error.startswith("error: ")
    assert error.count("\n") == 1
    return error


def test_figures_that_do_not_exist_are_dashes() -> None:
    """As after a run of a single episode, whose intervals are null."""
    absent = dict.fromkeys(CELL) | {
        f"{name}_ci": [None, None] for name in ("success_rate", "fall_rate", "velocity_error")
    }
    absent["yaw_rate_error_ci"] = [None, None]
    found = with_nan(FOUND | {"policies": {"trot": {"scenarios": {"flat": absent}}}})
    assert every_figure(found)[4] == "| flat | `trot` | – [–] | – [–] | – [–] | – [–] |"
    assert "| flat ground | – (–) |" in newcomers_table(found)


def test_an_interrupted_run_is_refused(capsys, tmp_path) -> None:
    assert "--resume" in refused(capsys, tmp_path, json.dumps(FOUND | {"complete": False}))


@pytest.mark.parametrize(
    "content", ["", "{", "[]", "null", "{}", '{"policies": []}', json.dumps(FOUND | {"versions": None})]
)
def test_what_is_no_outcome_is_refused(capsys, tmp_path, content) -> None:
    assert "results.json" in refused(capsys, tmp_path, content)


SCORE = {"policy": "trot", "score": 0.471, "ci": [0.432, 0.534], "axes": {}, "difference": 0.0, "p_value": 1.0}


def of_robot(robot: str, *policies: str) -> dict:
    scores = [SCORE | {"policy": policy} for policy in policies]
    return FOUND | {"scores": scores, "provenance": {"hardware": {"robot": robot}}}


def test_other_robots_have_a_row_each(tmp_path) -> None:
    path = tmp_path / "README.md"
    path.write_text("<!-- results -->\n<!-- /results -->\n<!-- robots -->\n<!-- /robots -->\n", encoding="utf-8")
    page = tmp_path / "page.md"
    page.write_text("<!-- results -->\n<!-- /results -->\n", encoding="utf-8")
    alike(tmp_path)
    files = {}
    for name, found in (
        ("here", FOUND),
        ("one", of_robot("simple_quad", "trot", "residual")),
        ("other", of_robot(str(tmp_path / "alike.xml"), "residual", "mpc_wbc")),
    ):
        files[name] = tmp_path / f"{name}.json"
        files[name].write_text(json.dumps(found), encoding="utf-8")
    words = ["readme", str(files["here"]), "--readme", str(path), "--page", str(page), "--robots"]
    assert main([*words, str(files["one"]), str(files["other"])]) == 0
    table = path.read_text(encoding="utf-8").split("<!-- robots -->\n")[1].splitlines()
    assert table[0] == "| robot | `residual` |"  # what all of them have
    assert table[2] == "| simple_quad, 14.2 kg on legs of 0.60 m | 47\N{NO-BREAK SPACE}% [43,\N{NO-BREAK SPACE}53] |"
    assert table[3].startswith("| alike, 1.4 kg on legs of 0.24 m | ")
    assert main([*words, str(files["here"])]) == 2  # it has no scores
