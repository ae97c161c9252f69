"""Minari dataset of a policy's episodes: what it saw, did and earned, and the environment, which can be made again.

Its library collects by a wrapper that needs JAX; the episodes are handed to it whole instead.
"""

import errno
import os
import shutil
import warnings
from collections.abc import Callable, Iterator
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np
from numpy.typing import NDArray

from evaluate.records.provenance import policy_digest, versions
from policies.base import Policy
from quad_env.cli.command_line import UsageError

PACKAGES = ("minari", "h5py")
"""What the extra `dataset` installs."""
REQUIRED = {"mujoco": "mujoco", "numpy": "numpy", "quad_env": "simple-quad"}
"""Distributions whose versions the episodes' bits hang on, by what `versions` calls them."""
ROOM = 1_000_000
"""Free bytes that are wanted besides twice those of the episodes."""
Progress = Callable[[float], None]


def check(name: str) -> Path:
    """Where the dataset of that name will be; UsageError where there can be none."""
    if missing := [package for package in PACKAGES if find_spec(package) is None]:
        raise UsageError(f'a dataset needs {missing[0]}: pip install -e ".[dataset]"')
    from minari.dataset.minari_dataset import parse_dataset_id
    from minari.storage import get_dataset_path

    try:
        parse_dataset_id(name)
    except (ValueError, TypeError):
        raise UsageError(f"a dataset is named as simple-quad/trot-v0, not {name}") from None
    try:
        path = Path(get_dataset_path(name))
    except OSError as error:
        raise UsageError(f"the datasets' folder MINARI_DATASETS_PATH cannot be made ({error.strerror})") from error
    if path.exists():
        raise UsageError(f"the dataset {name} exists already, in {path}: name another one or another version")
    return path


def create(name: str, env: gym.Env[Any, Any], policy: Policy, seeds: range, author: str, progress: Progress) -> None:
    """Write the dataset of an episode of each seed; nothing is left of it if that fails or is interrupted.

    Raises:
        UsageError: see `check`; or the policy failed.
        OSError: the disk is full.
    """
    import minari

    path, digest, known = check(name), policy_digest(policy), versions()
    episodes = list(_episodes(env, policy, seeds, progress))
    _check_room(path, episodes)
    assert env.spec is not None
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", UserWarning)  # of no e-mail address and no link
            dataset = minari.create_dataset_from_buffers(
                name,
                episodes,
                env=env,
                eval_env=env,
                algorithm_name=policy.name,
                author=author,
                description=_description(env.spec.kwargs, policy, seeds),
                requirements=[f"{package}=={known[each]}" for each, package in REQUIRED.items() if known[each]],
            )
        dataset.storage.update_metadata({"policy_digest": digest, "git_revision": known["git_revision"]})
    except BaseException:
        shutil.rmtree(path, ignore_errors=True)
        raise


def _episodes(env: gym.Env[Any, Any], policy: Policy, seeds: range, progress: Progress) -> Iterator[Any]:
    from minari.data_collector.episode_buffer import EpisodeBuffer

    for number, seed in enumerate(seeds):
        yield EpisodeBuffer(id=number, seed=seed, **_episode(env, policy, seed))
        if (reasons := getattr(policy, "failure", None)) is not None and reasons[0] is not None:
            raise UsageError(f"{policy.name} failed in the episode of seed {seed}: {reasons[0]}")
        progress((number + 1) / len(seeds))


def _episode(env: gym.Env[Any, Any], policy: Policy, seed: int) -> dict[str, Any]:
    """One episode: observations and infos of the start and every step, the rest of every step."""
    policy.reset(num_envs=1, seed=0)
    observation, info = env.reset(seed=seed)
    seen, told = [observation], [info]
    steps: list[tuple[NDArray[np.float32], float, bool, bool]] = []
    ended = False
    space = env.action_space
    assert isinstance(space, gym.spaces.Box)
    while not ended:
        action = np.clip(policy.act(seen[-1]), space.low, space.high)  # as the environment would
        observation, reward, terminated, truncated, info = env.step(action)
        seen.append(observation)
        told.append(info)
        steps.append((action, float(reward), terminated, truncated))
        ended = terminated or truncated
    actions, rewards, terminations, truncations = map(np.array, zip(*steps, strict=True))
    return {
        "observations": np.array(seen),
        "actions": actions,
        "rewards": rewards,
        "terminations": terminations,
        "truncations": truncations,
        "infos": {key: np.array([each[key] for each in told]) for key in told[0]},
    }


def _check_room(path: Path, episodes: list[Any]) -> None:
    """Raise OSError where the disk has no room for them: HDF5 fails halfway, and leaves files that cannot be closed."""
    wanted = ROOM
    for each in episodes:
        arrays = each.observations, each.actions, each.rewards, *each.infos.values()
        wanted += 2 * sum(array.nbytes for array in arrays)
    if shutil.disk_usage(next(folder for folder in path.parents if folder.exists())).free < wanted:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC), str(path))


def _description(kwargs: dict[str, Any], policy: Policy, seeds: range) -> str:
    scenario, robot = kwargs["scenario"].name, kwargs["robot"]
    return (
        f"{len(seeds)} episodes of the policy {policy.name} on the scenario {scenario}, robot {robot}: episode i is "
        f"that of env.reset(seed={seeds.start} + i). Actions are joint targets, rad; infos have a row "
        "more than actions, as observations do."
    )
