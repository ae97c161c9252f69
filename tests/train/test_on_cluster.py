"""Training seeds and the candidates of a search on a Ray cluster of two nodes: the results of this machine."""

import dataclasses
import shlex
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

from quad_env import SCENARIOS
from quad_env.extensions import Extension
from tests.ray_nodes import MISSING, REASON, killed_workers, two_nodes
from train.__main__ import main
from train.run_folder import steps_done

pytestmark = [
    pytest.mark.skipif(MISSING, reason=REASON),
    pytest.mark.skipif(not sys.platform.startswith("linux"), reason="looks into /proc"),
    pytest.mark.filterwarnings("default"),  # warnings of Ray
]
TINY = shlex.split(
    "--threads 1 --mixture flat 1 --validation.episodes 1 --validation.scenarios flat --max-episode-steps 8 "
    "--ppo.envs 8 --ppo.rollout-steps 8 --ppo.minibatch 64 --ppo.epochs 1 --ppo.actor 4 --ppo.critic 4 --robot dog.xml"
)
SEARCH = "search trot --generations 2 --candidates 4 --episodes 3 --steps 101 --check-episodes 3 --exercises flat"
SAME = ("config.json", "validations.json", "last/policy.safetensors")
"""Files of a run that do not depend on the time that it took."""


@pytest.fixture(scope="module")
def address() -> Iterator[str]:
    with two_nodes() as found:
        yield found


def contents(folder: Path, seeds: tuple[int, ...] = (3, 4)) -> dict[str, bytes]:
    found = {}
    for seed in seeds:
        (run,) = folder.glob(f"*-{seed}")
        found |= {f"{seed} {name}": (run / name).read_bytes() for name in SAME}
    return found


def test_seeds_train_the_same_policies_though_workers_are_killed_and_resume_here(
    address: str, repository: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys
) -> None:
    monkeypatch.chdir(tmp_path)
    model = repository / "quad_env/robots/simple_quad/simple_quad.xml"
    (tmp_path / "dog.xml").write_bytes(model.read_bytes())
    words = [*TINY, "--steps", "256", "--seeds", "3-4"]
    with killed_workers(2, 4.0) as killed:
        assert main([*words, "--out", "apart", "--ray", address]) == 0
    assert killed
    printed = capsys.readouterr()
    assert all(f"seed {seed}: the policy is apart/" in printed.out for seed in (3, 4))
    assert main([*words, "--out", "here"]) == 0
    assert contents(tmp_path / "apart") == contents(tmp_path / "here")
    for out in ("apart", "here"):
        assert main([*TINY, "--steps", "320", "--seeds", "3-4", "--resume", "--out", out]) == 0
    assert contents(tmp_path / "apart") == contents(tmp_path / "here")
    (run,) = (tmp_path / "apart").glob("*-3")
    assert not [path for path in run.rglob("*.json") if "quad-env-" in path.read_text(encoding="utf-8")]
    assert steps_done(run) == 320


def test_a_search_finds_the_same_parameters(address: str, tmp_path: Path) -> None:
    words = [*SEARCH.split(), "--threads", "1"]
    assert main([*words, "--out", str(tmp_path / "here/found.json")]) == 0
    assert main([*words, "--ray", address, "--out", str(tmp_path / "apart/found.json")]) == 0
    files = {path.name: path.read_bytes() for path in (tmp_path / "here").iterdir()}
    assert {"found.json", "found.trials.jsonl", "TROT.md"} <= set(files)
    assert {path.name: path.read_bytes() for path in (tmp_path / "apart").iterdir()} == files


def test_a_search_uses_the_scenario_of_an_extension(address: str, tmp_path: Path, added) -> None:
    added(Extension(scenarios={"mine": dataclasses.replace(SCENARIOS["flat"], name="mine")}))
    words = [*SEARCH.replace("--exercises flat", "--exercises mine").split(), "--threads", "1"]
    assert main([*words, "--out", str(tmp_path / "here/found.json")]) == 0
    assert main([*words, "--ray", address, "--out", str(tmp_path / "apart/found.json")]) == 0
    assert (tmp_path / "apart/found.json").read_bytes() == (tmp_path / "here/found.json").read_bytes()


def test_a_cluster_without_several_seeds_is_refused(capsys: pytest.CaptureFixture[str]) -> None:
    assert main([*TINY[:-2], "--ray"]) == 2
    assert capsys.readouterr().err == "error: --ray: needs --seeds, got none; valid: --seeds 0-4 --ray\n"
