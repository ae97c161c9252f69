"""Faults in the writers of deployment files: each makes the policy that is read back act differently."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
import pytest

from policies.history import Inputs
from quad_env.robots.registry import get_robot
from tests.planted_faults.harness import Faults, Plant, checks_of, fault_tests
from tests.train.export.plain_policies import make_policy
from train.export import isaac_lab, mjlab, plain_network, rl_sar, unitree
from train.export.export import FORMATS, largest_difference, read_back
from train.export.plain_network import PlainNetwork

TOLERANCE = 1e-6
"""Largest difference of joint targets, rad, and of gains, relative."""


def differences(to: str) -> tuple[float, float]:
    """Return the differences of the joint targets, rad, and of the gains between a policy and its export."""
    clock: dict[str, Any] = {"clock": 2.2, "clock_at_rest": "hidden"} if to in ("unitree", "isaac-lab", "toml") else {}
    history = () if to == "rl-sar" else (0.02, 0.06)
    policy = make_policy(get_robot("go2"), Inputs(lags=history, **clock), ignored=("linear_velocity",))
    network = plain_network.plain_network(policy, "mine")
    with TemporaryDirectory() as folder:
        FORMATS[to].write(network, Path(folder))
        copy = read_back(policy, Path(folder) / FORMATS[to].settings)
        gains = np.abs(copy.robot.gains / policy.robot.gains - 1.0).max()
        return largest_difference(policy, copy), float(gains)


def check_unitree_s_file_is_the_policy() -> None:
    assert max(differences("unitree")) < TOLERANCE


def check_mjlab_s_file_is_the_policy() -> None:
    assert max(differences("mjlab")) < TOLERANCE


def check_isaac_lab_s_file_is_the_policy() -> None:
    assert max(differences("isaac-lab")) < TOLERANCE


def check_rl_sar_s_file_is_the_policy() -> None:
    assert max(differences("rl-sar")) < TOLERANCE


def check_the_toml_is_the_policy() -> None:
    assert max(differences("toml")) < TOLERANCE


def changed(owner: Any, name: str, change: Callable[[Any], Any]) -> Plant:
    """Return a fault: a function returns a changed result."""

    def plant(patch: pytest.MonkeyPatch) -> None:
        true = getattr(owner, name)
        patch.setattr(owner, name, lambda *args, **kwargs: change(true(*args, **kwargs)))

    return plant


def exchange_front_legs(motors: np.ndarray) -> np.ndarray:
    return motors[[3, 4, 5, 0, 1, 2, 6, 7, 8, 9, 10, 11]]


def exchange_names(metadata: dict[str, str]) -> dict[str, str]:
    names = np.array(metadata["joint_names"].split(","))
    return metadata | {"joint_names": ",".join(exchange_front_legs(names))}


def gains_in_degrees(config: dict[str, Any]) -> dict[str, Any]:
    return config | {"rl_kp": np.radians(config["rl_kp"]).tolist()}


def unitree_gains_in_degrees(settings: dict[str, Any]) -> dict[str, Any]:
    return settings | {"stiffness": np.radians(settings["stiffness"]).tolist()}


def scaled_again(settings: dict[str, Any]) -> dict[str, Any]:
    action = settings["actions"]["joint_pos"]
    action["scale"] = {name: value**2 for name, value in action["scale"].items()}
    return settings


def scaled_network(network: PlainNetwork) -> PlainNetwork:
    scale = np.array(network.spec.action_scale)
    weights = (*network.weights[:-1], network.weights[-1] * scale)
    return replace(network, weights=weights, biases=(*network.biases[:-1], network.biases[-1] * scale))


def newest_first(layout: tuple[Any, np.ndarray]) -> tuple[Any, np.ndarray]:
    terms, matrix = layout
    ends = np.cumsum([term.width * term.history for term in terms])[:-1]
    parts = zip(terms, np.split(matrix, ends), strict=True)
    flipped = [part.reshape(term.history, term.width, -1)[::-1].reshape(part.shape) for term, part in parts]
    return terms, np.concatenate(flipped)


def without_gate(network: PlainNetwork) -> PlainNetwork:
    return replace(network, gate=None)


def gravity_up(terms: Any) -> list[Any]:
    return [(term, -factors if term.name == "projected_gravity" else factors) for term, factors in terms]


FAULTS: Faults = {
    "motors of FR and FL exchanged": (
        changed(unitree, "motors_of_joints", exchange_front_legs),
        check_unitree_s_file_is_the_policy,
    ),
    "clock runs at rest": (changed(unitree, "with_clock_gate", without_gate), check_unitree_s_file_is_the_policy),
    "names of FR and FL exchanged": (changed(mjlab, "_metadata", exchange_names), check_mjlab_s_file_is_the_policy),
    "joint mapping of FR and FL exchanged": (
        changed(rl_sar, "motors_of_joints", exchange_front_legs),
        check_rl_sar_s_file_is_the_policy,
    ),
    "stiffness of the motors in degrees": (
        changed(unitree, "_settings", unitree_gains_in_degrees),
        check_unitree_s_file_is_the_policy,
    ),
    "stiffness in degrees": (changed(rl_sar, "_config", gains_in_degrees), check_rl_sar_s_file_is_the_policy),
    "action scale twice in the file": (
        changed(isaac_lab, "_settings", scaled_again),
        check_isaac_lab_s_file_is_the_policy,
    ),
    "action scale in the network and in the file": (
        changed(plain_network, "_without_ignored_terms", scaled_network),
        check_the_toml_is_the_policy,
    ),
    "newest step first": (changed(plain_network, "_lay_out", newest_first), check_unitree_s_file_is_the_policy),
    "newest step first in mjlab": (changed(plain_network, "_lay_out", newest_first), check_mjlab_s_file_is_the_policy),
    "gravity points up": (changed(plain_network, "_observation_terms", gravity_up), check_the_toml_is_the_policy),
}


test_the_code_passes, test_the_fault_turns_its_check_red, test_every_check_has_a_fault = fault_tests(
    checks_of(globals()), FAULTS
)
