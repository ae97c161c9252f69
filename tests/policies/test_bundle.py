import hashlib
import itertools
import json
import pickle
import re
import resource
import shutil
from dataclasses import asdict, replace

import numpy as np
import pytest
from safetensors.numpy import load_file, save_file

import policies
from policies.bundle import DESCRIPTION, WEIGHTS, load, save
from policies.gaits import policy as gaits_policy
from policies.history import Inputs
from policies.mpc.sighted import SightedMpcWbc
from policies.network import Network
from policies.parameters import ParameterFile
from policies.residual import Features, ResidualPolicy
from policies.residual_bases import BASES, base_from_json, base_to_json
from policies.shipped import MODELS, models_folder
from policies.trot.integral import integral_parameters
from policies.trot.open_loop import Trot, TrotParameters
from quad_env import OBSERVATION_SIZE, SIMPLE_QUAD, Robot
from quad_env.cli.command_line import UsageError
from quad_env.robots.similarity import scale_factor
from quad_env.sensing.height_scan import HeightScan, table_with
from research.training.seal import SealOptions, main
from tests.quad_env.robots.alike import alike
from tests.quad_env.robots.made import Made


def network(*sizes):
    rng = np.random.default_rng(7)
    weights = [rng.normal(0.0, 0.3, shape).astype(np.float32) for shape in itertools.pairwise(sizes)]
    return Network(tuple(weights), tuple(rng.normal(size=s).astype(np.float32) for s in sizes[1:]))


@pytest.fixture
def folder(tmp_path):
    """Return the folder of a valid bundle of a trot with non-default parameters."""
    base = Trot(replace(TrotParameters(), body_height=0.41, yaw_gain=1.07))
    policy = ResidualPolicy(base, network(62, 16, 12), authority=np.linspace(0.1, 0.3, 12, dtype=np.float32))
    save(tmp_path / "model", policy, training={"steps": 5, "seed": 0}, git_revision="abc123")
    return tmp_path / "model"


def rewrite(folder, **changes):
    """Change top-level fields of the description; None removes a field."""
    description = json.loads((folder / DESCRIPTION).read_text(encoding="utf-8")) | changes
    (folder / DESCRIPTION).write_text(
        json.dumps({k: v for k, v in description.items() if v is not None}), encoding="utf-8"
    )


def replace_weights(folder, content):
    """Replace the weights, and set their SHA-256 in the description."""
    (folder / WEIGHTS).write_bytes(content)
    rewrite(folder, weights_sha256=hashlib.sha256(content).hexdigest())


def save_tensors(folder, tensors):
    save_file(tensors, folder / WEIGHTS)
    replace_weights(folder, (folder / WEIGHTS).read_bytes())


def trajectory(policy, steps=20):
    rng = np.random.default_rng(8)
    policy.reset(3)
    width = table_with(policy.robot, policy.height_scan).size
    seen = rng.normal(size=(steps, 3, width)).astype(np.float32)
    return b"".join(policy.act(each).tobytes() for each in seen)


def test_a_loaded_policy_acts_bit_for_bit_as_the_saved_one(tmp_path):
    inputs = Inputs(lags=(0.04, 0.08), averages=(0.5,), clock=2.0)
    base = policies.make("trot")
    corrections = network(Features(base, inputs).width, 16, 12)
    policy = ResidualPolicy(base, corrections, inputs=inputs, hold=2)
    save(tmp_path, policy, {}, "unknown")
    found = load(tmp_path)
    assert (found.features.inputs, found.hold) == (inputs, 2)
    assert trajectory(found) == trajectory(policy)


def test_corrections_without_bounds_survive_saving_and_older_bundles_have_bounds(tmp_path):
    base = policies.make("stand")
    inputs = Inputs(clock=2.0, clock_at_rest="hidden")
    policy = ResidualPolicy(base, network(Features(base, inputs).width, 12), inputs=inputs, bounded=False)
    save(tmp_path, policy, {}, "unknown")
    found = load(tmp_path)
    assert (found.bounded, found.features.inputs) == (False, inputs)
    trace = trajectory(found)
    assert np.abs(found.correction).max() > 1.0
    assert trace == trajectory(policy)
    inputs_before = {"lags": [], "averages": [], "clock": 2.0}
    rewrite(tmp_path, bounded=None, inputs=inputs_before, description_sha256=None)
    older = load(tmp_path)
    assert (older.bounded, older.features.inputs) == (True, Inputs(clock=2.0))
    bounded = ResidualPolicy(base, policy.network, inputs=Inputs(clock=2.0))
    assert trajectory(older) == trajectory(bounded) != trace


@pytest.mark.parametrize("name", BASES)
def test_a_residual_over_any_base_loads_as_it_was_whatever_has_been_searched_since(tmp_path, monkeypatch, name):
    base = policies.make(name, servo="own")
    policy = ResidualPolicy(base, network(Features(base).width, 8, 12))
    save(tmp_path, policy, training={}, git_revision="")
    in_force = ParameterFile.load_for_robot
    monkeypatch.setattr(ParameterFile, "load_for_robot", lambda *of: replace(in_force(*of), frequency=1.5))
    monkeypatch.setattr(gaits_policy, "searched_parameters", lambda *_: pytest.fail("that is another base"))
    loaded = load(tmp_path)
    assert (loaded.base.name, type(loaded.base)) == (name, type(base))
    assert trajectory(loaded, 6) == trajectory(policy, 6)
    assert "policies." not in (tmp_path / DESCRIPTION).read_text(encoding="utf-8")


def test_a_base_that_predicts_is_told_what_drives_and_reads_its_joints(tmp_path):
    base = policies.make("mpc_wbc", sensors="typical", actuator="motor")
    save(tmp_path, ResidualPolicy(base, network(Features(base).width, 8, 12)), training={}, git_revision="")
    hardware = {"sensors": "typical", "actuator": "motor"}
    assert trajectory(policies.resolve(tmp_path, **hardware).base) == trajectory(base)
    assert trajectory(load(tmp_path).base) == trajectory(policies.make("mpc_wbc")) != trajectory(base)


def test_a_height_scan_is_that_of_the_training(tmp_path):
    base = SightedMpcWbc(height_scan=HeightScan(ahead=3, behind=4, aside=2, delay=0.02))
    policy = ResidualPolicy(base, network(Features(base).width, 8, 12))
    assert policy.features.width == OBSERVATION_SIZE + 8 * 5 + 2 + 12
    save(tmp_path, policy, training={}, git_revision="")
    assert load(tmp_path).height_scan == base.height_scan
    for change, reason in (({"ahead": 2}, "observation"), ({"ahead": -1}, "ahead")):
        changed = json.loads((tmp_path / DESCRIPTION).read_text(encoding="utf-8"))["base"]
        changed["height_scan"] |= change
        assert reason in damaged(tmp_path, lambda f, base=changed: rewrite(f, base=base))
    blind = {key: value for key, value in base_to_json(base).items() if key != "height_scan"}
    with pytest.raises(ValueError, match="mpc_wbc_sighted needs a height_scan"):
        base_from_json(blind, SIMPLE_QUAD, 0.01)


def test_the_network_over_a_base_without_eyes_may_be_shown_a_scan(tmp_path):
    base = policies.make("trot", height_scan=HeightScan(ahead=1, behind=1, aside=0, noise=0.03))
    policy = ResidualPolicy(base, network(Features(base).width, 8, 12))
    save(tmp_path, policy, training={}, git_revision="")
    assert load(tmp_path).base.height_scan == base.height_scan
    observation = np.random.default_rng(0).normal(size=(2, OBSERVATION_SIZE + 3)).astype(np.float32)
    seen, hidden = policies.make("trot"), load(tmp_path).base
    np.testing.assert_array_equal(_acted(hidden, observation), _acted(seen, observation[:, :OBSERVATION_SIZE]))


def _acted(policy, observation):
    policy.reset(len(observation))
    return policy.act(observation)


@pytest.mark.parametrize("name", ["behaviour", "residual", "safe:trot"])
def test_what_is_more_than_a_name_and_numbers_is_no_base(tmp_path, name):
    base = policies.make(name)
    policy = ResidualPolicy(base, network(Features(base).width, 12))
    with pytest.raises(ValueError, match=r"one of bound, .*, walk, not "):
        save(tmp_path, policy, training={}, git_revision="")


def test_a_base_with_other_parameters_than_were_trained_on_is_refused(folder):
    base = json.loads((folder / DESCRIPTION).read_text(encoding="utf-8"))["base"]
    base["parameters"]["duty"] += 0.01
    assert "trained on (SHA-256 differs)" in damaged(folder, lambda f: rewrite(f, base=base))


def test_everything_but_the_weights_is_readable_in_the_description(folder):
    description = json.loads((folder / DESCRIPTION).read_text(encoding="utf-8"))
    assert description["env_id"] == "SimpleQuad-v0"
    assert description["observation"]["command"] == [45, 48]
    assert len(description["observation_scale"]) == OBSERVATION_SIZE
    assert description["network"] == {"sizes": [62, 16, 12], "activation": "elu"}
    assert description["base"]["name"] == "trot"
    assert description["base"]["parameters"]["body_height"] == 0.41
    assert description["training"] == {"steps": 5, "seed": 0}
    assert description["git_revision"] == "abc123"
    assert description["weights_sha256"] == hashlib.sha256((folder / WEIGHTS).read_bytes()).hexdigest()
    np.testing.assert_array_equal(load(folder).authority, np.linspace(0.1, 0.3, 12, dtype=np.float32))


def test_a_bundle_is_found_by_its_path_and_by_its_name(folder, monkeypatch):
    expected = trajectory(load(folder))
    assert trajectory(policies.resolve(str(folder))) == expected
    assert trajectory(policies.resolve(folder)) == expected
    folder.rename(folder.with_name("residual"))
    monkeypatch.setattr(policies.shipped, "MODELS", folder.parent)
    assert trajectory(policies.make("residual")) == expected


def damaged(folder, damage):
    damage(folder)
    with pytest.raises(policies.PolicyError) as caught:
        load(folder)
    assert "\n" not in str(caught.value)
    return str(caught.value)


@pytest.mark.parametrize("file", [DESCRIPTION, WEIGHTS])
@pytest.mark.parametrize("keep", [None, 0, -20])
def test_a_missing_or_truncated_file_is_refused(folder, file, keep):
    def cut(f):
        content = (f / file).read_bytes()
        (f / file).unlink() if keep is None else (f / file).write_bytes(content[:keep])

    assert file in damaged(folder, cut)


class Trap:
    """Object that writes a file when it is unpickled."""

    def __init__(self, path):
        self.path = path

    def __reduce__(self):
        return (open, (str(self.path), "w"))


@pytest.mark.parametrize("write", [replace_weights, lambda f, content: (f / DESCRIPTION).write_bytes(content)])
def test_a_pickle_is_refused_and_not_run(folder, tmp_path, write):
    damaged(folder, lambda f: write(f, pickle.dumps(Trap(tmp_path / "ran"))))
    assert not (tmp_path / "ran").exists()


@pytest.mark.parametrize(("tensor", "value"), [("0.weight", np.nan), ("1.bias", -3e38)])
def test_weights_that_no_training_makes_are_refused(folder, tensor, value):
    tensors = load_file(folder / WEIGHTS)
    changed = tensors | {tensor: np.full_like(tensors[tensor], value)}
    assert re.search(r"finite|1e\+06", damaged(folder, lambda f: save_tensors(f, changed)))


@pytest.mark.parametrize(
    "change",
    [
        lambda t: t | {"0.weight": t["0.weight"].T.copy()},
        lambda t: t | {"0.weight": t["0.weight"].astype(np.float64)},
        lambda t: t | {"2.weight": t["1.weight"]},
        lambda t: t | {"1.bias": np.array(t["1.bias"][0])},
    ],
    ids=["transposed", "float64", "one too many", "no vector"],
)
def test_tensors_other_than_described_are_refused(folder, change):
    damaged(folder, lambda f: save_tensors(f, change(load_file(f / WEIGHTS))))


def test_a_network_for_other_inputs_than_its_base_gives_is_refused(folder):
    def narrow(f):
        tensors = load_file(f / WEIGHTS)
        save_tensors(f, tensors | {"0.weight": tensors["0.weight"][:61].copy()})
        rewrite(f, network={"sizes": [61, 16, 12], "activation": "elu"})

    assert "needs 62 inputs and 12 outputs, not 61 and 12" in damaged(folder, narrow)


@pytest.mark.parametrize(
    ("change", "reason"),
    [
        ({"schema_version": 2}, "schema_version"),
        ({"network": None}, "lacks network"),
        ({"name": "walk\x1b[31m"}, "printable"),
        ({"env_id": "Ant-v5"}, "env_id differs from that of this SimpleQuad-v0 with simple_quad: 'Ant-v5'"),
        ({"observation": {"command": [0, 3]}}, "observation differs"),
        ({"observation_scale": [1.0] * OBSERVATION_SIZE}, "observation_scale differs"),
        ({"network": {"sizes": [62, 16, 12], "activation": "__import__"}}, "are not of the network"),
        ({"network": {"sizes": [62, 32, 12], "activation": "elu"}}, "are not of the network"),
        ({"base": {"name": "gallop", "parameters": {}, "sha256": ""}}, "gallop"),
        ({"base": {"name": "stand", "parameters": {"height": 0.4}, "sha256": ""}}, "Stand has no parameters"),
        (
            {"base": {"name": "walk", "parameters": {"walk": {}}, "sha256": ""}},
            "those of bound, pace, pronk",
        ),
        ({"base": {"name": "stand", "parameters": {}, "module": "policies.stand"}}, "name and parameters"),
        ({"authority": [0.3] * 11}, "authority"),
        ({"authority": [10**400] * 12}, "authority"),
        ({"authority": [3.2] * 12}, "authority"),
        ({"inputs": {"clock": 60}}, "clock"),
        ({"hold": 0}, "hold"),
        ({"inputs": {"lags": 0.1}}, "Inputs.lags is of the type tuple"),
        ({"weights_sha256": "0" * 64}, "SHA-256"),
        ({"extra": 1}, "extra"),
        ({"gait_authority": [0.0, 0.1, 0.0]}, "its gait_authority is [0.0, 0.1, 0.0], which this version cannot do"),
        ({"robot": "my_robot"}, "say which with --robot"),
        ({"model_sha256": "0" * 64}, "another model of simple_quad"),
    ],
)
def test_field_that_does_not_fit_is_refused(folder, change, reason):
    assert reason in damaged(folder, lambda f: rewrite(f, **change))


@pytest.mark.parametrize(("field", "value"), [("duty", np.inf), ("frequency", "fast"), ("frequency", 10**400)])
def test_base_parameter_out_of_range_is_refused(folder, field, value):
    base = json.loads((folder / DESCRIPTION).read_text(encoding="utf-8"))["base"]
    base["parameters"][field] = value
    assert "the base's parameters" in damaged(folder, lambda f: rewrite(f, base=base))


@pytest.mark.parametrize("content", ["[]", "{", "[" * 100_000])
def test_description_that_is_no_description_is_refused(folder, content):
    damaged(folder, lambda f: (f / DESCRIPTION).write_text(content, encoding="utf-8"))


def test_what_is_no_policy_is_answered_with_the_names_and_a_missing_path_as_such(tmp_path):
    with pytest.raises(policies.PolicyError, match="document_repaired"):
        policies.resolve("nothing")
    with pytest.raises(
        policies.PolicyError, match=f"there is no file or folder {re.escape(str(tmp_path / 'nothing'))}"
    ):
        policies.resolve(str(tmp_path / "nothing"))
    with pytest.raises(policies.PolicyError, match=DESCRIPTION):
        policies.resolve(tmp_path)


def test_a_training_run_is_found_as_its_best_bundle(folder, tmp_path):
    """`evaluate runs/mine` finds the bundles best/ and last/ of the training run."""
    run = tmp_path / "runs" / "mine"
    shutil.copytree(folder, run / "best")
    (run / "config.json").write_text("{}", encoding="utf-8")
    assert trajectory(policies.resolve(str(run))) == trajectory(load(run / "best")) == trajectory(load(folder))


@pytest.mark.parametrize(
    ("files", "remedy"),
    [
        (("config.json", "tensorboard/events"), "its first validation"),
        (("notes.txt",), "name the folder of a trained policy, such as models/residual, or of a training run"),
        (("config.json", "best/policy.json"), "best: policy.json is not JSON"),
    ],
)
def test_a_folder_without_a_bundle_says_what_to_do(tmp_path, files, remedy):
    for name in files:
        (tmp_path / name).parent.mkdir(exist_ok=True)
        (tmp_path / name).write_text("", encoding="utf-8")
    with pytest.raises(policies.PolicyError) as refused:
        policies.load(tmp_path)
    assert remedy in str(refused.value)
    assert (refused.value.remedy == "train it again, or fetch a complete copy") == ("best/policy.json" in files)


def test_a_bundle_of_a_users_robot_is_for_that_model_alone(tmp_path):
    robot = alike(tmp_path)
    save(tmp_path / "model", ResidualPolicy(Trot(robot=robot), network(62, 12)), training={}, git_revision="")
    found = policies.resolve(tmp_path / "model", robot=robot)
    assert found.robot == robot
    assert found.base.parameters == Trot(robot=robot).parameters
    renamed = replace(robot, name="renamed")  # the robot of the file is renamed as well
    assert policies.resolve(tmp_path / "model", robot=renamed).robot == renamed
    with pytest.raises(policies.PolicyError, match="say which with --robot"):
        policies.resolve(tmp_path / "model")
    with pytest.raises(policies.PolicyError, match="was made for simple_quad"):
        policies.resolve(MODELS / "residual", robot=robot)
    heavier = alike(tmp_path, heavier=0.11)  # replaces the first robot
    with pytest.raises(policies.PolicyError, match="trained on another model of"):
        policies.resolve(tmp_path / "model", robot=heavier)


def test_joints_in_another_order_are_another_robots(tmp_path):
    ours, theirs = (
        Robot.from_mjcf(Made(order=order).write(tmp_path, f"{order[0]}.xml"), name="made")
        for order in (("fr", "fl", "hr", "hl"), ("fl", "fr", "hl", "hr"))
    )
    save(tmp_path / "model", ResidualPolicy(Trot(robot=ours), network(62, 12)), training={}, git_revision="")
    with pytest.raises(policies.PolicyError, match="joints differs from that"):
        policies.resolve(tmp_path / "model", robot=theirs)


def test_what_was_found_for_a_users_robot_lies_beside_its_file(tmp_path):
    robot = alike(tmp_path)
    assert models_folder(robot) == tmp_path / robot.name
    with pytest.raises(policies.PolicyError, match=f"no trained policy in {tmp_path / robot.name}"):
        policies.make("residual", robot=robot)
    own = models_folder(robot)
    save(own / "residual", ResidualPolicy(Trot(robot=robot), network(62, 12)), training={}, git_revision="")
    assert policies.make("residual", robot=robot).robot == robot
    searched = replace(Trot(robot=robot).parameters, body_height=0.1)
    (own / "trot.json").write_text(json.dumps(asdict(searched)), encoding="utf-8")
    assert policies.make("trot", robot=robot).parameters == searched
    integral = policies.make("trot_integral", robot=robot).parameters
    assert integral.body_height == 0.1
    assert integral.integral_gain == pytest.approx(scale_factor(robot, "1/s") * integral_parameters().integral_gain)
    assert models_folder(SIMPLE_QUAD) == MODELS


@pytest.mark.parametrize("changes", [{"authority": [0.3] * 12}, {"hold": 2}, {"inputs": {}}, {"git_revision": "x"}])
def test_a_description_that_was_altered_is_refused(folder, changes):
    rewrite(folder, **changes)
    with pytest.raises(policies.PolicyError, match="is not as it was written"):
        load(folder)
    rewrite(folder, description_sha256=None)  # format of older versions
    load(folder)


def test_the_digests_of_shipped_policies_are_made_by_a_command(tmp_path):
    """Each bundle without digest equals one of an older version, and has its present bytes again after sealing."""
    for shipped in sorted(MODELS.glob("**/policy.json")):
        shutil.copytree(shipped.parent, made := tmp_path / shipped.parent.relative_to(MODELS), dirs_exist_ok=True)
        rewrite(made, description_sha256=None)
        assert main(SealOptions((made,))) == 0
        assert (made / DESCRIPTION).read_bytes() == shipped.read_bytes()
        if (made.parent, made.name) == (tmp_path, "residual"):
            rewrite(made, hold=3)
            with pytest.raises(UsageError, match="is not as it was written"):
                main(SealOptions((made,)))


@pytest.mark.parametrize(("name", "limit"), [(DESCRIPTION, "4 MiB"), (WEIGHTS, "128 MiB")])
def test_a_file_beyond_any_size_is_refused_by_its_size(folder, name, limit):
    with (folder / name).open("wb") as sparse:
        sparse.truncate(3 * 2**30)
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    with pytest.raises(policies.PolicyError, match=rf"{name} cannot be read \(it is larger than {limit}"):
        load(folder)
    assert resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before < 100 * 1024  # KiB
