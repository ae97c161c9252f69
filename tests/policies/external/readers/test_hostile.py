"""Hostile files, made to hang, to fill the memory or to raise: the error is one line, in a bounded processor time."""

import re
import sys
import time
from collections.abc import Callable
from contextlib import suppress
from copy import deepcopy
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from policies.base import PolicyError
from policies.external.readers import name_patterns, read
from policies.external.readers.settings import load_settings
from policies.external.reference import resolve_reference
from policies.external.spec import MAX_OBSERVATION, PolicySpec, SpecTerm
from quad_env.files.reading import NETWORK_LIMIT
from quad_env.files.text import brief

pytest.importorskip("resource")
pytest.importorskip("yaml")
pytest.importorskip("onnx")

import resource

import onnx
import yaml

from tests.policies.external.readers import files
from tests.policies.external.readers.files import network, write_settings

PATIENCE = 5.0
"""s. Maximum processor time for any file."""


def refusal(file: Path) -> str:
    """Return the error message of a file; it is one line and comes within `PATIENCE`."""
    began = time.process_time()
    with pytest.raises(PolicyError) as error:
        read(file)
    assert time.process_time() - began < PATIENCE
    line = str(error.value)
    assert "\n" not in line
    assert len(line) < 2000
    return line


def bomb(levels: int = 9, width: int = 9) -> str:
    """Return YAML anchors of a collection that expands to `width ** levels` leaves."""
    lines = ["a0: &a0 [x, x, x]"]
    lines += [f"a{n}: &a{n} [{', '.join([f'*a{n - 1}'] * width)}]" for n in range(1, levels)]
    return "\n".join(lines) + "\n"


def replaced(settings: Any, keys: str, value: Any) -> Any:
    settings = deepcopy(settings)
    *above, last = keys.split("/")
    inner = settings
    for key in above:
        inner = inner[key]
    inner[last] = value
    return settings


ALIASED = (
    "scene/robot/spawn/usd_path",
    "observations/policy/base_ang_vel/func",
    "observations/policy/velocity_commands/params/command_name",
    "actions/joint_pos/class_type",
    "commands/base_velocity/class_type",
    "scene/robot/actuators/hips/stiffness",
    "scene/robot/actuators/hips/joint_names_expr",
    "sim/dt",
    "decimation",
    "scene/robot/init_state/joint_pos",
)


@pytest.mark.parametrize("keys", ALIASED)
def test_nested_aliases_at_any_key_end_in_one_line(tmp_path: Path, keys: str) -> None:
    network(tmp_path)
    text = yaml.safe_dump(replaced(files.env(), keys, "PLACE"), sort_keys=False).replace("PLACE", "*a8", 1)
    file = tmp_path / "params/env.yaml"
    file.parent.mkdir(exist_ok=True)
    file.write_text(bomb() + text)
    assert "env.yaml" in refusal(file)


def test_a_collection_that_holds_itself_is_shown_in_bounded_time() -> None:
    nested: list[Any] = [1]
    nested.append(nested)
    assert brief(nested) == "[1, [1, […]]]"
    assert brief({"a" * 500: 10**5000, "b": [{}, [[]], range(3)]}) == (
        f"{{'{'a' * 60}'…: a whole number of {(10**5000).bit_length()} bits, 'b': [{{}}, [[]], a value of type range]}}"
    ).replace("[[]]", "[…]")


PATTERNS = st.recursive(
    st.sampled_from(["a", "b", "_", "F", ".", r"\w", r"\d", "[ab]", "[^a]", "[a-c_]", r"\.", "^", "$"]),
    lambda inner: st.one_of(
        st.builds("{}{}".format, inner, inner),
        st.builds("({}|{})".format, inner, inner),
        st.builds("(?:{})".format, inner),
        st.builds("(?!{}){}".format, inner, inner),
        st.builds("(?={}){}".format, inner, inner),
        st.builds("({}){}".format, inner, st.sampled_from(["*", "+", "?", "*?", "{2}", "{1,3}", "{,2}", "{2,}"])),
    ),
    max_leaves=8,
)


@settings(max_examples=300, deadline=None)
@given(PATTERNS, st.text("ab_FL.1", max_size=6))
def test_a_pattern_matches_what_it_matches_in_python(pattern: str, name: str) -> None:
    assert name_patterns.matches(pattern, name) == (re.fullmatch(pattern, name) is not None)


@pytest.mark.parametrize(
    ("pattern", "fits", "others"),
    [
        (".*_hip_joint", "FL_hip_joint", "FL_hip"),
        ("(FL|FR)_.*", "FR_calf_joint", "RR_calf_joint"),
        ("[FR]L_.*", "RL_thigh_joint", "FR_thigh_joint"),
        ("^(?!.*ankle).*", "left_knee", "left_ankle_roll"),
        ("F[L,R]_thigh_joint", "FL_thigh_joint", "FLL_thigh_joint"),
        (".*HAA", "LF_HAA", "LF_HFE"),
        (r"[fh][lr]_h[xy]", "fl_hy", "fl_kn"),
    ],
)
def test_patterns_of_isaac_lab_are_read(pattern: str, fits: str, others: str) -> None:
    assert name_patterns.matches(pattern, fits)
    assert not name_patterns.matches(pattern, others)


@pytest.mark.parametrize(
    "pattern",
    [
        r"((\w*)*)*!",
        "(a|a)*b",
        "(" * 15 + "a*" + ")*" * 15 + "!",
        "(.*){1000}" * 15 + "!",
        "(?!(.*)*!)" * 15 + "x",
        "(((.{0,900}){0,900}){0,900}){0,900}!",
    ],
)
def test_no_pattern_takes_long(tmp_path: Path, pattern: str) -> None:
    began = time.process_time()
    assert not name_patterns.matches(pattern, "a" * name_patterns.MAX_NAME)
    assert time.process_time() - began < PATIENCE
    network(tmp_path)
    changed = replaced(files.env(), "scene/robot/init_state/joint_pos", {pattern: -1.5})
    refusal(write_settings(tmp_path / "params/env.yaml", changed))


@pytest.mark.parametrize(
    "pattern", ["(", ")", "[", "a{", "a**", r"\q", r"(a)\1", "(?P<x>a)", "(?<=a)b", "x" * 300, "*"]
)
def test_what_is_no_pattern_is_refused(pattern: str) -> None:
    with pytest.raises(name_patterns.PatternError):
        name_patterns.matches(pattern, "a")


HUGE: dict[str, Callable[[], str]] = {
    "keys.json": lambda: "{" + ", ".join(f'"{number % 89_999}": 1' for number in range(90_000)) + "}",
    "keys_within.json": lambda: "{" + ", ".join(f'"{number % 29_999}": 1' for number in range(30_000)) + "}",
    "sixty.yaml": lambda: "a: " + "59:" * 150_000 + "59\n",
    "sixty_float.yaml": lambda: "a: " + "59:" * 150_000 + "59.0\n",
    "merged.yaml": lambda: (
        "a0: &a0 {x: 1, y: 2}\n"
        + "".join(f"a{n}: &a{n} {{<<: [{', '.join([f'*a{n - 1}'] * 9)}], k{n}: 1}}\n" for n in range(1, 12))
    ),
    "digits.yaml": lambda: "a: " + "9" * 500_000,
    "hexadecimal.yaml": lambda: "step_dt: 0x" + "f" * 200_000 + "\njoint_ids_map: 1\nactions: {}\n",
    "decimal.yaml": lambda: "a: 1." + "9" * 500_000,
    "parts.toml": lambda: ".".join("a" * 60_000) + " = 1\n",
    "many_parts.toml": lambda: ".".join("a" * 250_000) + " = 1\n",
    "tables.toml": lambda: "".join(f"[a{number}.b.c]\n" for number in range(9_000)),
    "nested.toml": lambda: "a = " + "[" * 50_000,
    "nested.json": lambda: "[" * 250_000,
    "nested.yaml": lambda: "a: " + "[" * 250_000,
    "nested_keys.yaml": lambda: "? " * 100_000,
    "number.json": lambda: '{"joint_ids_map": ' + "9" * 4000 + "}",
}


@pytest.mark.parametrize("name", HUGE)
def test_large_and_deep_files_end_in_one_line(tmp_path: Path, name: str) -> None:
    file = tmp_path / name
    file.write_text(HUGE[name]())
    refusal(file)


@pytest.mark.parametrize(
    ("text", "line"),
    [
        ("a: 1\na: 2\n", "line 2: 'a' is given twice"),
        ("b: {c: 1, d: 2, c: 3}\n", "line 1: 'c' is given twice"),
        ("a: !!timestamp x\n", "not a known deployment file"),
        ("a: 2024-01-01\n2024-01-02: 3\n", "not a known deployment file"),
        ("a: !!int x\n", "'x' is no whole number"),
        ("a: !!float x\n", "'x' is no number"),
        ("? [1, 2]\n: 3\n", "line 1 has a collection as a key"),
        ("? {a: 1}\n: 3\n", "line 1 has a collection as a key"),
        (f"{'k' * 500}: 1\n", "a key is a text of at most 200 characters"),
        ("a: !!set [1]\n", "no settings"),
        ("a: !!omap 3\n", "no settings"),
    ],
)
def test_yaml_is_read_strictly(tmp_path: Path, text: str, line: str) -> None:
    (tmp_path / "policy.yaml").write_text(text)
    assert line in refusal(tmp_path / "policy.yaml")


def test_keys_that_merge_others_may_replace_them(tmp_path: Path) -> None:
    (tmp_path / "a.yaml").write_text("a: &a {x: 1, y: 2}\nb: {<<: *a, x: 3}\nc: {<<: *a}\n")
    found = load_settings(tmp_path / "a.yaml").values
    assert (found["b"], found["c"]) == ({"x": 3, "y": 2}, {"x": 1, "y": 2})


@pytest.mark.parametrize("text", ['"５"', "'1_0'", "1_0", "1:30", "0x1g", "' 1'", "'1e3_0'", "１"])
def test_texts_that_only_python_takes_for_numbers_are_none(tmp_path: Path, text: str) -> None:
    network(tmp_path)
    plain = yaml.safe_dump(replaced(files.deploy(files.permutation(0)), "step_dt", "PLACE"), sort_keys=False)
    file = write_settings(tmp_path / "params/deploy.yaml", {})
    file.write_text(plain.replace("PLACE", text, 1), encoding="utf-8")
    assert "`step_dt` in deploy.yaml must be a number" in refusal(file)


@pytest.mark.parametrize(
    ("text", "value"), [("1e-3", 1e-3), ("0.02", 0.02), ("-.5", -0.5), ("0x10", 16), ("1.0e+2", 100)]
)
def test_numbers_as_exporters_write_them_are_read(tmp_path: Path, text: str, value: float) -> None:
    (tmp_path / "a.yaml").write_text(f"a: {text}\n")
    assert load_settings(tmp_path / "a.yaml").number("a") == value


IMPLAUSIBLE = [
    ("control/action_scale", 0.0, "`action_scale` is 0 for every joint"),
    ("control/action_scale", 1e3, "`action_scale` is beyond any robot's"),
    (
        "control/stiffness",
        {"joint": 1e9},
        "`stiffness` is beyond any robot's: got 1e+09; valid: 0.001 to 10000 N·m/rad",
    ),
    ("control/damping", {"joint": 1e9}, "`damping` is beyond any robot's"),
    ("sim/dt", 1e-200, "`control_rate` is beyond any robot's"),
    ("sim/dt", 1e200, "`control_rate` is beyond any robot's"),
    ("normalization/obs_scales/dof_vel", 1e9, "`scale` is beyond any robot's"),
    ("normalization/clip_observations", 1e-200, "`observation_clip` is beyond any robot's"),
]


@pytest.mark.parametrize(("keys", "value", "line"), IMPLAUSIBLE)
def test_numbers_beyond_any_robot_are_named(tmp_path: Path, keys: str, value: Any, line: str) -> None:
    network(tmp_path)
    assert line in refusal(write_settings(tmp_path / "settings.yaml", replaced(files.legged_gym(), keys, value)))


def test_an_observation_has_a_largest_width(tmp_path: Path) -> None:
    made = {
        "network": tmp_path / "net.onnx",
        "control_rate": 50.0,
        "joints": files.MOTORS,
        "default_position": (0.0,) * 12,
        "action_scale": (0.25,) * 12,
        "stiffness": (20.0,) * 12,
        "damping": (0.5,) * 12,
    }
    step = SpecTerm("joint_position", history=1000)
    with pytest.raises(PolicyError, match=f"an observation has at most {MAX_OBSERVATION}"):
        PolicySpec(**made, terms=(step,) * 20_000)  # type: ignore[arg-type]
    wide = SpecTerm("constant", values=(0.0,) * 5_000)
    with pytest.raises(PolicyError, match="show 5012000 numbers"):
        PolicySpec(**made, terms=(step, wide))  # type: ignore[arg-type]
    assert PolicySpec(**made, terms=(step, step)).width == 24_000  # type: ignore[arg-type]


def test_metadata_that_is_no_text_and_long_metadata_are_refused(tmp_path: Path) -> None:
    file = files.onnx_file(tmp_path / "policy.onnx", {"joint_names": "PLACE"})
    file.write_bytes(file.read_bytes().replace(b"PLACE", b"\xff\xfe\x80\xff\xff"))
    assert "policy.onnx has metadata at 'joint_names' that is not UTF-8" in refusal(file)
    files.onnx_file(file, {"joint_names": "a," * 50_000})
    assert "metadata of 100000 characters at 'joint_names'" in refusal(file)


@pytest.mark.parametrize("inside", [False, True])
def test_a_network_that_draws_random_numbers_is_named(tmp_path: Path, inside: bool) -> None:
    helper, kind = onnx.helper, onnx.TensorProto.FLOAT
    node = helper.make_node("RandomNormalLike", ["obs"], ["act"])
    if inside:
        branch = helper.make_graph([node], "b", [], [helper.make_tensor_value_info("act", kind, [1, 12])])
        node = helper.make_node("If", ["on"], ["act"], then_branch=branch, else_branch=branch)
    ends = [helper.make_tensor_value_info(name, kind, [1, 12]) for name in ("obs", "act")]
    model = helper.make_model(helper.make_graph([node], "g", ends[:1], ends[1:]))
    (tmp_path / "policy.onnx").write_bytes(model.SerializeToString())
    assert "policy.onnx draws random numbers, by the operator RandomNormalLike" in refusal(tmp_path / "policy.onnx")


def test_a_huge_network_is_refused_by_its_size(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    file = tmp_path / "policy.onnx"
    with file.open("wb") as sparse:
        sparse.truncate(2**31)
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    assert f"it is larger than 128 MiB; {NETWORK_LIMIT} raises the limit" in refusal(file)
    assert resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before < 100 * 1024
    monkeypatch.setenv(NETWORK_LIMIT, "1")
    file.write_bytes(bytes(2**20 + 1))
    assert "it is larger than 1 MiB" in refusal(file)


def test_random_bytes_are_refused(tmp_path: Path) -> None:
    rng = np.random.default_rng(0)
    for suffix in (".onnx", ".yaml", ".json", ".toml"):
        for number in range(20):
            file = tmp_path / f"{number}{suffix}"
            file.write_bytes(rng.bytes(int(rng.integers(1, 300))))
            with suppress(PolicyError):
                assert read(file) is None  # an ONNX file without a description


@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="only Linux and macOS limit processor time")
def test_a_file_of_many_slow_patterns_is_given_up(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Each pattern takes a bounded time, and together they exceed the processor time of the reading process."""
    monkeypatch.setenv("QUAD_ENV_READ_TIME", "1")
    network(tmp_path)
    patterns = {f"(.*){{1000}}{'(.*)*' * 30}.{{{number % 5}}}(x|.{{{number}}}|.*)": 0.0 for number in range(2000)}
    changed = replaced(files.env(), "scene/robot/init_state/joint_pos", patterns)
    file = write_settings(tmp_path / "params/env.yaml", changed)
    began = time.process_time()
    with pytest.raises(PolicyError, match="it takes more than 1 s of processor time") as error:
        resolve_reference(file, trust=False)
    assert str(error.value).startswith(f"{file}: ")
    assert time.process_time() - began < PATIENCE


def test_long_values_make_no_long_lines(tmp_path: Path) -> None:
    network(tmp_path, "go2/robot_lab/policy.pt")
    config = files.rl_sar(files.permutation(1))[0]["go2/robot_lab"] | {"observations": ["a" * 5000]}
    file = write_settings(tmp_path / "go2/robot_lab/config.yaml", {"go2/robot_lab": config})
    write_settings(tmp_path / "go2/base.yaml", files.rl_sar(files.permutation(1))[1])
    assert len(refusal(file)) < 600
    toml = tmp_path / "policy.toml"
    toml.write_text(f'network = "policy.pt"\ncontrol_rate = {"9" * 4000}\njoints = []\ndefault_position = 0\n')
    with toml.open("a") as lines:
        lines.write('action_scale = 0.25\nstiffness = 20\ndamping = 0.5\nterms = ["command"]\n')
    assert len(refusal(toml)) < 600
