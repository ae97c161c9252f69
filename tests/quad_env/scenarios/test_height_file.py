"""User-defined ground: its orientation, the starts of robots on it, and invalid files."""

import os
import zlib
from dataclasses import replace
from pathlib import Path

import gymnasium as gym
import mujoco
import numpy as np
import pytest
from gymnasium.envs.registration import EnvSpec
from PIL import Image

import quad_env
from quad_env import ENV_ID
from quad_env.physics.model import compile_model
from quad_env.robots.simple_quad import SIMPLE_QUAD
from quad_env.scenarios.episode import EpisodeSample

RAMP = np.tile(np.arange(9), (5, 1))  # rising towards +x
CORNERED = RAMP.copy()
CORNERED[:2, 0] = 20, 10  # a step in the far left corner: the largest y and the least x
SIZE = (4.0, 2.0)


def written(folder: Path, values: np.ndarray, kind: str = "npy", lines: str = "", size: object = list(SIZE)) -> str:
    """Write values as a file of a kind and a TOML that names it, and return the path of the TOML."""
    file, toml = folder / f"hill.{kind}", folder / "hill.toml"
    if kind == "npy":
        np.save(file, values)
    else:
        Image.fromarray(values).save(file)
    toml.write_text(f'file = "{file.name}"\nsize = {size}\n{lines}', encoding="utf-8")
    return str(toml)


@pytest.mark.parametrize(
    ("kind", "values", "lines", "heights"),
    [
        ("png", (10 * CORNERED).astype(np.uint8), "height = 0.4", CORNERED * 0.02),
        ("png", (3000 * CORNERED).astype(np.uint16), "height = 0.4", CORNERED * 0.02),
        ("npy", CORNERED / 20 - 3.0, "", CORNERED / 20 - 3.0),
        ("npy", np.asfortranarray(CORNERED), "height = 1", CORNERED / 20),
    ],
)
def test_the_ground_lies_as_the_picture_is_seen_and_rays_hit_it_there(tmp_path, kind, values, lines, heights) -> None:
    terrain = quad_env.scenario(written(tmp_path, values, kind, lines)).terrain
    x, y = np.meshgrid(np.linspace(-2, 2, 9), np.linspace(1, -1, 5))
    np.testing.assert_allclose(terrain.height(x.ravel(), y.ravel()), heights.ravel(), atol=1e-6)
    beyond = np.array([[2.1, 0.0, -9.0], [0.0, -1.1, 9.0]])
    model = compile_model(SIMPLE_QUAD, quad_env.Scenario("made", terrain))
    data = mujoco.MjData(model)
    data.qpos[:2] = 100.0  # the robot is elsewhere
    mujoco.mj_forward(model, data)
    points = [*np.random.default_rng(0).uniform(-1, 1, (100, 2)) * np.array(SIZE) * 0.499, *beyond.T]
    down, found = np.array([0.0, 0.0, -1.0]), np.zeros(1, np.int32)
    for east, north in points:
        hit = 5.0 - mujoco.mj_ray(model, data, np.array([east, north, 5.0]), down, None, 1, -1, found)
        assert terrain.height(float(east), float(north)) == pytest.approx(hit, abs=1e-6)


@pytest.mark.parametrize("level", [-20.0, 1.0, 30.0])
def test_a_robot_is_put_on_the_ground_wherever_that_is(tmp_path, level) -> None:
    values = np.full((101, 201), level)
    values[:, 150:] += 0.5  # in the right half
    with gym.make(ENV_ID, scenario=written(tmp_path, values, lines="start = [-1.0, 0.5]")) as env:
        env.reset(seed=1)
        robot = env.unwrapped.simulation
        assert not robot.batch.warning.any(), "so deep in the ground MuJoCo finds more contacts than it has memory for"
        np.testing.assert_allclose(robot.qpos[0, :2], (-1.0, 0.5))
        assert not any(env.step(SIMPLE_QUAD.home_pose.astype(np.float32))[2] for _ in range(50))
        assert robot.qpos[0, 2] == pytest.approx(level + SIMPLE_QUAD.home_height, abs=0.03)
        assert robot.state((0.0, 0.0, 0.0), None).height == pytest.approx(robot.qpos[0, 2] - level)


def test_without_a_start_each_seed_draws_a_place_in_the_middle(tmp_path) -> None:
    hill = quad_env.scenario(written(tmp_path, RAMP))
    places = np.array([EpisodeSample(SIMPLE_QUAD, hill, seed, 0, 0.01).start[:2] for seed in range(50)])
    assert len(np.unique(places)) == 100
    assert 0.45 < np.abs(places).max() < 0.5, "a quarter of the shorter side"


def test_the_scenario_is_a_value_that_names_the_content_of_its_file(tmp_path) -> None:
    path = written(tmp_path, RAMP)
    scenario = quad_env.scenario(path)
    assert (scenario.name, quad_env.scenario(path)) == ("hill", scenario)
    with gym.make(ENV_ID, scenario=scenario) as env, gym.make(EnvSpec.from_json(env.spec.to_json())) as same:
        again = same.unwrapped.scenario
    assert (again, again.terrain.file) == (scenario, str(tmp_path / "hill.npy"))
    assert replace(scenario.terrain, file="elsewhere.npy") == scenario.terrain
    with pytest.raises(ValueError, match="has changed: its SHA-256"):
        gym.make(ENV_ID, scenario=replace(scenario, terrain=replace(scenario.terrain, sha256="0" * 64)))
    other = quad_env.scenario(written(tmp_path, RAMP + 1))
    assert (other == scenario, other.terrain.height(0.0, 0.0)) == (False, 5.0)
    theirs = quad_env.scenario(path, replace(SIMPLE_QUAD, name="short", thigh_length=0.075, calf_length=0.075))
    assert (theirs.terrain, theirs.commands == other.commands) == (other.terrain, False), "metres for every robot"


def bomb(content: bytes) -> bytes:
    """Return a PNG that claims a size of 20 000 x 20 000."""
    header = b"IHDR" + (20_000).to_bytes(4, "big") * 2 + content[24:29]
    return content[:12] + header + zlib.crc32(header).to_bytes(4, "big") + content[33:]


NAN, GREY = np.array([[0.0, np.nan], [0.0, 1.0]]), np.full((3, 3), 9, np.uint8)
HIGH = "height = 1.0"


@pytest.mark.parametrize(
    ("given", "words"),
    [
        ({"values": RAMP, "lines": "colour = 1"}, "no colour; valid: file, size, height, start"),
        (
            {"values": RAMP, "size": "8.0"},
            r"HeightField.size is of the type .*; it wants lines such as .* size = \[8.0, 8.0\]",
        ),
        ({"values": RAMP, "size": "[8.0, nan]"}, r"HeightField.size must be more than 0 m"),
        ({"values": RAMP, "lines": "start = [2.1, 0]"}, "start within"),
        ({"values": NAN}, r"hill.npy: heights are finite numbers"),
        ({"values": RAMP[:1]}, "at least 2 x 2 .* these are 1 x 9"),
        ({"values": np.zeros((2001, 2000), np.int8)}, "at most 4000000 samples.*2001 x 2000"),
        ({"values": np.array([[{}, 1], [2, 3]])}, "Object arrays cannot be loaded"),
        ({"values": GREY, "kind": "png"}, "height is needed"),
        ({"values": np.dstack([GREY] * 3), "kind": "png", "lines": HIGH}, "grey, 8 or 16 bit.*RGB"),
        ({"values": GREY, "kind": "bmp", "lines": HIGH}, r"picture \(.png\) or an array \(.npy\)"),
    ],
)
def test_what_is_no_ground_is_one_line(tmp_path, given, words) -> None:
    with pytest.raises(ValueError, match=words) as raised:
        quad_env.scenario(written(tmp_path, **given))
    assert "\n" not in str(raised.value)


def test_a_file_that_is_gone_damaged_or_no_file_is_one_line(tmp_path) -> None:
    path = written(tmp_path, GREY, "png", HIGH)
    picture, content = tmp_path / "hill.png", (tmp_path / "hill.png").read_bytes()
    for make, words in (
        (lambda: picture.write_bytes(content[:50]), "hill.png: "),
        (lambda: picture.write_bytes(bomb(content)), "hill.png: Decompression"),
        (picture.unlink, "cannot read .*hill.png .No such file"),
        (lambda: os.mkfifo(picture), "cannot read .*hill.png .it is no regular file"),
    ):
        make()
        with pytest.raises(ValueError, match=words):
            gym.make(ENV_ID, scenario=path)
    with pytest.raises(ValueError, match="call the file differently"):
        quad_env.scenario(str(tmp_path / "rough.toml"))
