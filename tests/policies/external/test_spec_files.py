"""Policies given by specification files: the fields that are read, trust, refusals, and the content of the digest."""

from contextlib import closing
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import policies
from policies.base import CONTROL_PERIOD, PolicyError
from policies.external import ExternalPolicy, is_reference
from policies.external.network_policy import NetworkPolicy
from policies.external.readers import write_toml
from policies.external.reference import PolicyReference, resolve_reference
from policies.external.server import make_server
from policies.external.spec import HeightGrid, PolicySpec, SpecTerm
from quad_env import OBSERVATION_SIZE, SIMPLE_QUAD, HeightScan
from tests.policies.external.small_networks import SmallNetwork, make_spec

pytest.importorskip("onnx")
pytest.importorskip("onnxruntime")

TERMS = (SpecTerm("joint_velocity", scale=(0.05,)), SpecTerm("command"))
WIDTH = 15


@pytest.fixture
def description(tmp_path: Path) -> PolicySpec:
    """Write the specification of an ONNX policy as policy.toml in its folder, and return the path."""
    made = make_spec(SmallNetwork(WIDTH).onnx(tmp_path / "policy.onnx"), TERMS)
    write_toml(made, tmp_path / "policy.toml")
    return made


def first_actions(reference: PolicyReference, row: np.ndarray) -> np.ndarray:
    """Return the policy's targets of the first control step."""
    of = make_server(reference, SIMPLE_QUAD, CONTROL_PERIOD, 5.0)
    of.reset(1, 0)
    return of.step(row).actions


def test_endings_of_files_that_describe_policies_are_references() -> None:
    assert all(
        is_reference(f"folder/policy{end}") for end in (".toml", ".yaml", ".yml", ".json", ".pt", ".jit", ".onnx")
    )
    assert not is_reference("policy.pth")


def test_the_file_that_describes_a_policy_names_it(description: PolicySpec, tmp_path: Path) -> None:
    observations = np.random.default_rng(0).normal(0.0, 0.3, (3, OBSERVATION_SIZE)).astype(np.float32)
    here = NetworkPolicy(description)
    here.reset(3)
    with closing(policies.resolve(str(tmp_path / "policy.toml"), servo="own")) as policy:
        assert isinstance(policy, ExternalPolicy)
        assert policy.spec == description
        assert policy.robot.servo == here.robot.servo != SIMPLE_QUAD.servo
        policy.reset(3)
        for _ in range(3):
            np.testing.assert_array_equal(policy.act(observations), here.act(observations))
        policy.reset_where(np.array([True, False, False]))
        assert policy.failure.tolist() == [None] * 3
        guarded = policies.resolve(f"safe:{tmp_path / 'policy.toml'}", servo="own")
        assert guarded.robot.servo == policy.robot.servo


def test_a_height_scan_is_asked_of_the_environment(tmp_path: Path) -> None:
    terms = (
        SpecTerm("joint_velocity"),
        SpecTerm("height_scan", grid=HeightGrid((-0.1, 0.0, 0.1), (0.0,))),
    )
    file = SmallNetwork(WIDTH).onnx(tmp_path / "policy.onnx")
    write_toml(make_spec(file, terms), tmp_path / "policy.toml")
    with closing(ExternalPolicy(tmp_path / "policy.toml")) as policy:
        assert policy.height_scan == HeightScan(ahead=1, behind=1, aside=0, spacing=0.1)
        policy.reset(1)
        policy.act(np.zeros((1, OBSERVATION_SIZE + 3), np.float32))
        assert policy.failure.tolist() == [None]


def test_torchscript_wants_trust_and_a_description_next_to_it(description: PolicySpec, tmp_path: Path) -> None:
    file = tmp_path / "policy.pt"
    file.write_bytes(b"nothing that is loaded")
    with pytest.raises(PolicyError, match=r"policy\.pt can run code .* --trust"):
        resolve_reference(file, trust=False)
    found = resolve_reference(file, trust=True)
    assert found.spec == replace(description, network=file)
    write_toml(found.spec, tmp_path / "other.toml")
    with pytest.raises(PolicyError, match=r"policy\.pt can run code"):
        resolve_reference(tmp_path / "other.toml", trust=False)
    (tmp_path / "policy.toml").unlink()
    with pytest.raises(PolicyError, match=r"does not say how its network is run; write a TOML .* as policy\.toml"):
        resolve_reference(file, trust=True)


def test_another_description_or_network_is_another_policy(description: PolicySpec, tmp_path: Path) -> None:
    file, contents = tmp_path / "policy.toml", set()
    for each in (description, replace(description, action_scale=(0.1,) * 12)):
        write_toml(each, file)
        contents.add(resolve_reference(file, trust=False).sha256)
    SmallNetwork(WIDTH, lstm=True).onnx(tmp_path / "policy.onnx")
    contents.add(resolve_reference(file, trust=False).sha256)
    assert len(contents) == 3


@pytest.mark.parametrize("name", ["policy.ONNX", "policy.bin", "policy", "policy.pt"])
def test_content_and_no_ending_tells_an_onnx_file(description: PolicySpec, tmp_path: Path, name: str) -> None:
    row = np.random.default_rng(0).normal(0.0, 0.3, (1, OBSERVATION_SIZE)).astype(np.float32)
    expected = NetworkPolicy(description).act(row)
    file = description.network.rename(tmp_path / name)
    write_toml(replace(description, network=file), tmp_path / "policy.toml")
    found = resolve_reference(tmp_path / "policy.toml", trust=False)
    np.testing.assert_array_equal(first_actions(found, row), expected)


@pytest.mark.parametrize("name", ["policy.ONNX", "policy.bin", "policy", "policy.pt"])
def test_weights_in_another_file_are_refused_whatever_the_ending(
    description: PolicySpec, tmp_path: Path, name: str
) -> None:
    onnx = pytest.importorskip("onnx")
    model = onnx.load(description.network)
    file = tmp_path / name
    description.network.unlink()
    onnx.save(model, file, save_as_external_data=True, location="weights.data", size_threshold=0)
    write_toml(replace(description, network=file), tmp_path / "policy.toml")
    with pytest.raises(PolicyError, match=r"the weights of policy.* lie in another file"):
        resolve_reference(tmp_path / "policy.toml", trust=True)
    if file.suffix == ".pt":
        with pytest.raises(PolicyError, match=r"the weights of policy.* lie in another file"):
            resolve_reference(file, trust=True)


@pytest.mark.parametrize("name", ["policy.pt", "policy.jit", "policy.onnx", "policy.bin"])
def test_torchscript_of_any_ending_wants_trust_and_runs(description: PolicySpec, tmp_path: Path, name: str) -> None:
    pytest.importorskip("torch")
    row = np.random.default_rng(0).normal(0.0, 0.3, (1, OBSERVATION_SIZE)).astype(np.float32)
    expected = NetworkPolicy(description).act(row)
    description.network.unlink()
    file = SmallNetwork(WIDTH).torchscript(tmp_path / name)
    write_toml(replace(description, network=file), tmp_path / "policy.toml")
    with pytest.raises(PolicyError, match=r"can run code .* --trust"):
        resolve_reference(tmp_path / "policy.toml", trust=False)
    named = file if file.suffix in (".pt", ".jit") else tmp_path / "policy.toml"
    found = resolve_reference(named, trust=True)
    np.testing.assert_allclose(first_actions(found, row), expected, atol=1e-6)


def test_a_checkpoint_is_called_what_it_is(description: PolicySpec, tmp_path: Path) -> None:
    torch = pytest.importorskip("torch")
    content = {"model_state_dict": {"actor.0.weight": torch.zeros(3)}, "optimizer_state_dict": {}, "iter": 5}
    torch.save(content, tmp_path / "model_1500.pt")
    torch.save(content, tmp_path / "old.pt", _use_new_zipfile_serialization=False)
    torch.save({"weights": 1}, tmp_path / "mine.pt")
    for name, learner in (("model_1500.pt", " of rsl_rl"), ("old.pt", " of rsl_rl"), ("mine.pt", "")):
        with pytest.raises(PolicyError, match=rf"{name} is a checkpoint{learner}, not TorchScript; .*exported/policy"):
            resolve_reference(tmp_path / name, trust=True)
        write_toml(replace(description, network=tmp_path / name), tmp_path / "policy.toml")
        with pytest.raises(PolicyError, match=rf"{name} is a checkpoint{learner}, not TorchScript; "):
            resolve_reference(tmp_path / "policy.toml", trust=True)


def test_what_is_no_description_of_a_policy_is_refused_in_words(tmp_path: Path) -> None:
    robot = tmp_path / "my_robot.toml"
    robot.write_text('mjcf = "my_robot.xml"\n', encoding="utf-8")
    with pytest.raises(PolicyError, match=r"my_robot\.toml: .*`mjcf`"):
        policies.resolve(str(robot))
    with pytest.raises(PolicyError, match="there is no file"):
        policies.resolve(str(tmp_path / "gone.yaml"))


def test_an_onnx_that_says_nothing_acts_on_our_observation(tmp_path: Path) -> None:
    file = SmallNetwork(OBSERVATION_SIZE).onnx(tmp_path / "policy.onnx")
    assert resolve_reference(file, trust=False).spec is None
    of = make_server(resolve_reference(file, trust=False), SIMPLE_QUAD, CONTROL_PERIOD, 5.0)
    of.reset(1, 0)
    observation = np.ones((1, OBSERVATION_SIZE), np.float32)
    np.testing.assert_allclose(
        of.step(observation).actions[0], SmallNetwork(OBSERVATION_SIZE).make_act()(observation[0]), atol=1e-5
    )
