"""Frames of a robot as it moves: what films, the report and pictures are made of."""

from collections.abc import Sequence
from contextlib import closing
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from evaluate.rollouts.hardware import IDEAL, Hardware
from evaluate.rollouts.rollout import watch
from policies.base import Policy
from quad_env.cli.command_line import UsageError
from quad_env.physics.arrows import Arrow
from quad_env.scenarios.scenario import Scenario

if TYPE_CHECKING:
    from quad_env.envs.vector_env import SimpleQuadVectorEnv

Frame = NDArray[np.uint8]
"""(height, width, 3)"""


class Filming:
    """Draws frames of the first of n robots, all of one size (width, height), pixels; close it in the end."""

    def __init__(self, size: tuple[int, int], camera: str = "track") -> None:
        self._view = *size, camera
        self._camera: Any = None

    def draw(self, env: "SimpleQuadVectorEnv", arrows: Sequence[Arrow] = ()) -> Frame:
        """The first robot as it is now, with these arrows.

        Raises:
            ValueError: there is no such camera; names those that there are.
            UsageError: nothing can be drawn here.
        """
        from quad_env.physics.rendering import Camera

        try:
            if self._camera is None:
                self._camera = Camera(env.simulation.model, *self._view)
            frame: Frame = self._camera.draw(env.simulation.snapshot(0), arrows=arrows)
        except ValueError:
            raise
        except Exception as error:  # whatever the graphics driver fails with
            raise UsageError(f"nothing can be drawn here ({type(error).__name__}: {error})") from error
        return frame

    def close(self) -> None:
        """Free the renderer."""
        if self._camera is not None:
            self._camera.close()


def frames_of(
    policy: Policy,
    scenario: str | Scenario,
    seed: int,
    *,
    first: int,
    every: int,
    count: int,
    size: tuple[int, int],
    camera: str = "track",
    command: ArrayLike | None = None,
    hardware: Hardware = IDEAL,
) -> list[Frame]:
    """`count` frames of an episode, one every so many control steps from the step `first` on.

    A fallen robot is shown where it lies; where the simulation diverges, the frames that are left are the last one.
    Raises as `Filming.draw` and `watch`.
    """
    taken: list[Frame] = []
    steps = watch(policy, scenario, seed, steps=first + (count - 1) * every, command=command, hardware=hardware)
    with closing(Filming(size, camera)) as filming, closing(steps):
        for step in steps:
            due = step.number >= first and (step.number - first) % every == 0
            if due or step.infos["diverged"][0]:
                taken.append(filming.draw(step.env))
    return taken + taken[-1:] * (count - len(taken))
