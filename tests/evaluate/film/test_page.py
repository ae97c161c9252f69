"""The page of an episode shows the recorded signals, and the frames of the same times."""

import dataclasses
import json
import math
import re
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image

import policies
import quad_env
from evaluate.cells import LabelledPolicy
from evaluate.film.curves import estimated_state
from evaluate.film.page import write_page
from evaluate.film.shooting import EpisodeView, FilmSpec
from evaluate.measures.episodes import Episodes
from evaluate.rollouts import rollout
from quad_env import Pushes

PUSHES = Pushes(count=1, window=(0.05, 0.2), impulse=20.0)
SCENARIO = dataclasses.replace(quad_env.scenario("noise:2"), pushes=PUSHES)
STEPS, SEED, HOSTILE = 250, 4, "</script><b>trot"


@dataclass
class Written:
    """Page with two policies; one of them falls."""

    text: str = ""
    data: dict[str, Any] = field(default_factory=dict)
    drawn: list[int] = field(default_factory=list)
    """Control step of each frame."""


@pytest.fixture(scope="module")
def page(tmp_path_factory: pytest.TempPathFactory) -> Written:
    found, path = Written(), tmp_path_factory.mktemp("page") / "page.html"

    def picture(panel: EpisodeView) -> Image.Image:
        found.drawn.append(panel.step.number)
        return Image.new("RGB", (480, 300))

    shown = LabelledPolicy("document", policies.make("document")), LabelledPolicy(HOSTILE, policies.make("trot"))
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(EpisodeView, "picture", picture)
        write_page(FilmSpec(shown, SCENARIO, SEED, STEPS, "an <i>episode</i>"), path, lambda _: None)
    found.text = path.read_text(encoding="utf-8")
    found.data = json.loads(re.search(r'id="data">(.*?)</script>', found.text, re.DOTALL).group(1))
    return found


@pytest.fixture(scope="module", params=[0, 1])
def both(request: pytest.FixtureRequest, page: Written) -> tuple[dict[str, Any], Episodes]:
    """Return the data of the page for each policy, and the record of the same episode by the evaluator."""
    policy = policies.make(("document", "trot")[request.param])
    return page.data["episodes"][request.param], rollout.run(policy, SCENARIO, np.array([SEED]), steps=STEPS)


def test_every_curve_is_the_episodes_signal(both) -> None:
    shown, record = both
    end = min(int(record.fall_step[0]), STEPS)
    share = (record.peak_torque / np.array(record.torque_limit)).reshape(STEPS, 1, 4, 3).max(axis=-1)
    names = ("foot_contact", "tilt", "height", "heading_velocity", "command", "foot_height")
    expected = {name: getattr(record, name) for name in names} | {"torque_share": share}
    assert shown["curves"].keys() == {*expected, "given"}
    for name, signal in expected.items():
        columns = np.array(shown["curves"][name]).T
        np.testing.assert_allclose(columns[:end], signal[:end, 0].reshape(end, -1), atol=6e-5, err_msg=name)
    given = estimated_state(record.observed[:end, 0].astype(float))
    np.testing.assert_allclose(np.array(shown["curves"]["given"]).T[:end], given, atol=6e-5)
    assert shown["legs"] == ["FL", "FR", "HL", "HR"]
    assert shown["fallen"] == pytest.approx({"tilt": math.radians(70.0), "height": 0.12}, abs=1e-3)


def test_a_film_has_a_frame_each_twentieth_second_until_a_second_after_the_fall(page) -> None:
    falling, walking = page.data["episodes"]
    fall = next(event["time"] for event in falling["events"] if event["kind"] == "fall")
    assert (falling["end"], walking["end"]) == (pytest.approx(fall + 1.0), pytest.approx(0.01 * STEPS))
    assert page.data["period"] == 0.05
    numbers = [[5 * k for k in range(len(each["frames"]))] for each in (falling, walking)]
    assert [numbers[0][-1], numbers[1][-1]] == [math.floor(falling["end"] / 0.05 + 1e-9) * 5, STEPS]
    assert page.drawn == [*numbers[0], *numbers[1]]
    counts = {len(values) for columns in falling["curves"].values() for values in columns}
    assert counts == {round(100 * falling["end"])}


def test_fall_cause_and_pushes_are_marked_when_they_happened(both) -> None:
    shown, record = both
    marks = {event["kind"]: event for event in shown["events"]}
    first = 0.01 * record.push_step[0, 0]
    assert (marks["push"]["time"], marks["push"]["until"]) == pytest.approx((first, first + 0.1))
    assert marks["push"]["words"] == "push 20 N·s"
    assert [event["time"] for event in shown["events"]] == sorted(event["time"] for event in shown["events"])
    fell = record.fall_step[0] < STEPS
    assert ("fall" in marks, shown["label"] == "document") == (fell, fell)
    if fell:
        assert marks["fall"]["time"] == pytest.approx(0.01 * (record.fall_step[0] + 1))
        assert marks["fall"]["words"] == "fell: trunk contact"
        assert "cause" in marks
        assert shown["story"][-1]["time"] == pytest.approx(marks["fall"]["time"])


def test_a_page_is_one_offline_file_whatever_a_policy_is_called(page) -> None:
    assert "default-src 'none'" in page.text
    assert not re.search(r"(src|href)=|@import|url\(|fetch\(|https?://(?!www.w3.org/2000/svg)", page.text)
    assert page.text.count("</script>") == 2
    assert "<i>episode" not in page.text
    assert page.data["episodes"][1]["label"] == HOSTILE
    assert all(frame.startswith("data:image/webp;base64,") for frame in page.data["episodes"][0]["frames"])


def test_what_a_policy_is_given_is_read_in_its_own_idea_of_the_vertical() -> None:
    """The tilt defines the vertical: roll to the right of 0.3 rad, 1 m/s ahead, 0.5 m/s
    sideways, yaw rate of 2 rad/s.
    """
    cos, sin = math.cos(0.3), math.sin(0.3)
    to_body = np.array([[1.0, 0.0, 0.0], [0.0, cos, sin], [0.0, -sin, cos]])
    observed = np.concatenate([to_body @ each for each in ([0.0, 0.0, -1.0], [0.0, 0.0, 2.0], [1.0, 0.5, 0.0])])
    np.testing.assert_allclose(estimated_state(observed[None]), [[0.3, 1.0, 0.5, 2.0]])


def test_a_page_is_whole_or_absent(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def stop(_: float) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr(EpisodeView, "picture", lambda *_: Image.new("RGB", (8, 5)))
    take = FilmSpec((LabelledPolicy("stand", policies.make("stand")),), SCENARIO, 0, 20, "an episode")
    with pytest.raises(KeyboardInterrupt):
        write_page(take, tmp_path / "page.html", stop)
    assert list(tmp_path.iterdir()) == []
