"""The film: which episode it shows, and that the page comes out where nothing can be rendered."""

import dataclasses
import io

import numpy as np
import pytest
from PIL import Image

from evaluate.report import footage as module
from evaluate.report.footage import Take, choose, film, footage
from evaluate.rollouts.hardware import IDEAL
from quad_env import SCENARIOS


def test_it_shows_the_first_episode_that_splits_those_who_ran_it_most_evenly(made) -> None:
    """On level ground: trot alone falls in episodes 2 … 19 of push:3, and in 28 … 37 of push:6."""
    third = tuple(dataclasses.replace(c, policy="third") for c in made.cells if c.scenario.name == "flat")
    take = choose(dataclasses.replace(made, cells=third + made.cells))
    assert take is not None
    assert (take.scenario.name, take.episode, take.seed, take.policies) == ("push:3", 2, 2, ("trot", "other"))
    assert take.first_step == 0  # the fall after 2 s, and what follows, are within the first 4 s


def test_it_shows_what_led_to_a_late_fall(made) -> None:
    late = [
        dataclasses.replace(c, measures=dataclasses.replace(c.measures, fall_time=c.measures.fall_time + 5.0))
        for c in made.cells
    ]
    take = choose(dataclasses.replace(made, cells=tuple(late)))
    assert take is not None
    assert take.first_step == 450  # 7 s and 1.5 s more, less 4 s


def test_without_a_scenario_that_two_policies_ran_there_is_none(made) -> None:
    alone = tuple(c for c in made.cells if c.policy == "trot" and c.scenario.name != "rough")
    other = tuple(c for c in made.cells if c.policy == "other" and c.scenario.name == "rough")
    assert choose(dataclasses.replace(made, cells=alone + other)) is None


def test_where_nothing_can_be_rendered_the_page_says_so(made, monkeypatch) -> None:
    monkeypatch.setenv("MUJOCO_GL", "nonsense")
    cells = tuple(dataclasses.replace(c, policy="stand" if c.policy == "other" else c.policy) for c in made.cells)
    page = footage(dataclasses.replace(made, cells=cells))
    assert "No film: rendering is impossible here" in page
    assert "nonsense" in page


@pytest.mark.rendering
def test_a_film_shows_the_robot_moving(monkeypatch) -> None:
    monkeypatch.setattr(module, "FRAMES", 4)
    with Image.open(io.BytesIO(film("trot", Take(SCENARIOS["flat"], 0, 5, 20, ("trot",)), IDEAL))) as image:
        strip = np.asarray(image.convert("RGB")).astype(int)
    assert strip.shape == (4 * module.HEIGHT, module.WIDTH, 3)
    frames = strip.reshape(4, module.HEIGHT, module.WIDTH, 3)
    assert frames.std(axis=(1, 2)).min() > 5.0
    assert (np.abs(np.diff(frames, axis=0)).max(axis=-1) > 40).mean(axis=(1, 2)).min() > 0.001
