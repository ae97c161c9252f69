"""Infos have types that buffers, wrappers and batches of other projects support."""

from typing import Any

import numpy as np
import pytest
from gymnasium.vector import AutoresetMode, SyncVectorEnv

import quad_env
from quad_env.envs.env import SimpleQuadEnv
from quad_env.envs.vector_env import SimpleQuadVectorEnv
from quad_env.robots.simple_quad import SIMPLE_QUAD

HOME = SIMPLE_QUAD.home_pose.astype(np.float32)
LOW = np.tile(np.float32([0, -1.5, 0]), 4)
"""Joint targets that lower the trunk to the ground, rad."""


def fallen(**options: Any) -> tuple[SimpleQuadVectorEnv, list[dict[str, Any]]]:
    """Return a batch in which only robot 0 has just fallen, and its previous infos."""
    env = SimpleQuadVectorEnv(2, **options)
    infos = [env.reset(seed=0)[1]]
    while not infos[-1]["fall"][0] and "final_info" not in infos[-1]:
        infos.append(env.step(np.array([LOW, HOME]))[4])
    return env, infos


def check_numbers(infos: dict[str, Any], count: int) -> None:
    for key, value in infos.items():
        if isinstance(value, dict):
            assert key == "final_info"
            check_numbers(value, count)
        else:
            assert isinstance(value, np.ndarray), key
            assert (value.dtype.kind in "fib", value.shape[0]) == (True, count), key
        if not key.startswith("_"):
            assert infos[f"_{key}"].dtype == bool
            assert infos[f"_{key}"].shape == (count,)


@pytest.mark.parametrize("mode", list(AutoresetMode))
def test_infos_of_a_batch_are_arrays_of_numbers_with_a_mask_each(mode: AutoresetMode) -> None:
    env, infos = fallen(autoreset_mode=mode, readings=True, sensors="typical", actuator="motor")
    for info in (*infos, env.step(np.tile(HOME, (2, 1)))[4]):
        check_numbers(info, 2)


def test_infos_of_one_robot_are_numbers_or_arrays_of_numbers() -> None:
    env = SimpleQuadEnv(sensors="typical")
    for info in (env.reset(seed=0)[1], env.step(HOME)[4]):
        for key, value in info.items():
            assert isinstance(value, np.generic | np.ndarray), key  # TorchRL requires a dtype
            assert value.dtype.kind in "fib", key


def test_the_code_of_a_fall_names_its_reason_and_costs_one_once() -> None:
    assert quad_env.FALL_REASONS == ("none", "trunk_contact", "tilt", "height")
    _, infos = fallen()
    assert infos[-1]["fall"].dtype == np.int8
    assert [info["reward_fall"].tolist() for info in infos] == [[0.0, 0.0]] * (len(infos) - 1) + [[-1.0, 0.0]]
    assert [quad_env.FALL_REASONS[code] for code in infos[-1]["fall"]] == ["trunk_contact", "none"]
    single = SimpleQuadEnv()
    codes = [single.reset(seed=0)[1]["fall"], *(single.step(LOW)[4]["fall"] for _ in infos[1:])]
    assert [code.dtype for code in codes] == [np.dtype(np.int8)] * len(infos)
    assert codes == [info["fall"][0] for info in infos]


def test_gymnasiums_own_batch_of_single_environments_has_the_infos_of_the_native_one() -> None:
    def same(of_gym: dict[str, Any], native: dict[str, Any]) -> None:
        assert set(of_gym) == set(native)
        for key, value in native.items():
            assert value.dtype == of_gym[key].dtype, key
            np.testing.assert_array_equal(value, of_gym[key], err_msg=key)

    batches = SyncVectorEnv([lambda: SimpleQuadEnv(sensors="ideal")] * 2), SimpleQuadVectorEnv(2, sensors="ideal")
    same(*(batch.reset(seed=3)[1] for batch in batches))
    for _ in range(80):  # robot 0 falls and is reset
        same(*(batch.step(np.array([LOW, HOME]))[4] for batch in batches))
