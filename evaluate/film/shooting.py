"""The images of a film: one episode of one policy or of several, side by side, with captions and marks."""

import math
from collections.abc import Callable, Generator, Iterator, Sequence
from contextlib import ExitStack, closing
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageDraw

from evaluate.cells import LabelledPolicy
from evaluate.film import captions, files
from evaluate.film.scene import COMMAND, VELOCITY, Scene
from evaluate.hardware import IDEAL, HardwareConfig
from evaluate.measures import metrics
from evaluate.measures.outcomes import DIVERGED, FELL, SUCCEEDED, SUCCESS_RULE
from evaluate.measures.tracking import SETTLING_TIME
from evaluate.rollouts.observers import Step
from evaluate.rollouts.rollout import Recorder, iterate_episode
from policies.base import CONTROL_PERIOD
from quad_env.cli.command_line import UsageError
from quad_env.physics.arrows import Arrow, Ball
from quad_env.robots.similarity import scale_to_robot
from quad_env.scenarios.scenario import Scenario

POST_FALL_TIME = 1.0
"""s that are shown after a fall."""
NEAR = 1.8
"""m from a free camera to SimpleQuad's trunk."""
SHOOTING = 0.8
"""Share of simulating and drawing in the work of a film; the rest writes its file."""
STRIP_RATE = 5.0
"""Frames of a second from which those of a strip are chosen."""
ALARM, GOOD, BAD = (200, 30, 30), (0, 130, 90), (190, 110, 0)
Progress = Callable[[float], None]


@dataclass(frozen=True)
class FilmSpec:
    """What is filmed: policies, side by side, in the same episode of a scenario."""

    policies: tuple[LabelledPolicy, ...]
    scenario: Scenario
    seed: int
    steps: int
    title: str
    hardware: HardwareConfig = IDEAL
    command: tuple[float, float, float] | None = None
    """Held for the whole episode; None: the scenario draws commands."""


@dataclass(frozen=True)
class RenderOptions:
    """How it is filmed."""

    size: tuple[int, int] = (640, 480)
    """Width and height of each robot's frames, pixels."""
    camera: str | None = "track"
    """One of the model's; None: a free one near the robot's left side, faster and without shadows."""
    speed: float = 1.0
    """1 is real time, less is slow motion."""
    rate: float = 25.0
    """Frames a second, about: a whole number of control steps lies between two."""
    arrows: bool = True
    """Whether arrows are drawn."""

    @property
    def steps_per_frame(self) -> int:
        """Control steps from a frame to the next."""
        return max(1, round(self.speed / (self.rate * CONTROL_PERIOD)))

    @property
    def period(self) -> float:
        """Time for which a frame is shown, s."""
        return self.steps_per_frame * CONTROL_PERIOD / self.speed

    @property
    def font_size(self) -> int:
        """Size of the captions' letters, pixels."""
        return max(captions.SMALLEST, min(self.size) // 30)


def film(spec: FilmSpec, path: Path, progress: Progress, look: RenderOptions = RenderOptions()) -> None:
    """Film an episode into a file, see `files`.

    Raises:
        ValueError: there is no such camera, or a policy is for another robot.
        UsageError: nothing can be drawn here, or the film is longer than its format can be.
        OSError: nothing can be written there.
    """
    if path.suffix.lower() == files.STRIP:
        look = replace(look, rate=STRIP_RATE)
    files.check_pixels(path, (spec.steps // look.steps_per_frame + 1) * len(spec.policies) * math.prod(look.size))
    with closing(render_frames(spec, look, lambda share: progress(SHOOTING * share))) as images:
        files.write(images, path, look.period)
    progress(1.0)


def render_frames(spec: FilmSpec, look: RenderOptions, progress: Progress) -> Generator[Image.Image]:
    """The images, until shortly after the last robot's fall; the last one says what came of each. Raises as `film`."""
    count = len(spec.policies)
    columns = count if count <= 3 else math.ceil(math.sqrt(count))
    with ExitStack() as stack:
        panels = [stack.enter_context(closing(EpisodeView(policy, spec, look))) for policy in spec.policies]
        for number in range(spec.steps + 1):
            over = number == spec.steps or all(panel.over for panel in panels)
            if over or number % look.steps_per_frame == 0:
                tiles = files.tiled([panel.draw(over) for panel in panels], columns)
                yield _headed(tiles, spec, look, panels[0].step, number)
                progress(number / spec.steps)
            if over:
                break
            for panel in panels:
                panel.advance()
    progress(1.0)


def _headed(tiles: Image.Image, spec: FilmSpec, look: RenderOptions, step: Step, number: int) -> Image.Image:
    """The tiles below title, time and command, which are the same for all."""
    text = captions.Text(look.font_size)
    out = Image.new("RGB", (tiles.width, text.height(2) + tiles.height), captions.DARK)
    out.paste(tiles, (0, text.height(2)))
    slowed = "" if look.speed == 1.0 else f" at {look.speed:g} of real time"
    room = text.write(out, f"{number * step.env.dt:.2f} s{slowed}", 0, right=True)
    text.write(out, spec.title, 0, taken=room)
    text.write(out, f"command {captions.motion(step.infos['command'][0])}", 1, captions.ink(COMMAND))
    return out


class EpisodeView:
    """One policy's part of the film, step by step, with what is drawn of it; close it in the end."""

    def __init__(self, policy: LabelledPolicy, spec: FilmSpec, look: RenderOptions) -> None:
        self._label, self._look, self._count = policy.label, look, spec.steps
        self._camera: Any = None
        walker = policy.policy_for(spec.scenario)
        self.recorder = Recorder(walker, np.array([spec.seed]), spec.steps)
        where = walker, spec.scenario, spec.seed
        self._steps = iterate_episode(*where, steps=spec.steps, command=spec.command, hardware=spec.hardware)
        self.step = next(self._steps)
        """The control step that the episode is at."""
        self.recorder(self.step)
        self._scene = Scene(self.step)
        self._has_outcome = spec.steps > round(SETTLING_TIME / self.step.env.dt)

    def __iter__(self) -> Iterator[Step]:
        """The start and the control steps until shortly after its fall."""
        yield self.step
        while not self.over and self.step.number < self._count:
            self.advance()
            yield self.step

    def advance(self) -> None:
        """Simulate a control step; a robot whose simulation has diverged stays as it is."""
        step = next(self._steps, None)
        if step is not None:
            self.step = step
            self.recorder(step)
            self._scene.advance(step)

    @property
    def over(self) -> bool:
        """Whether nothing more is to be seen."""
        falls = self.recorder.falls
        past = self.step.number - (falls.step[0] + 1)
        return bool(
            falls.fell[0] and (self.step.infos["diverged"][0] or past >= round(POST_FALL_TIME / self.step.env.dt))
        )

    def picture(self) -> Image.Image:
        """The robot now, with marks where they are wanted; framed red once it has fallen."""
        marks = self._scene.marks() if self._look.arrows else ()
        image = Image.fromarray(self._frame(marks))
        if marks and self.recorder.falls.fell[0]:
            ImageDraw.Draw(image).rectangle(
                (0, 0, *np.subtract(image.size, 1)), outline=ALARM, width=image.height // 60
            )
        return image

    def _frame(self, marks: Sequence[Arrow | Ball]) -> NDArray[np.uint8]:
        """The robot as it is now, with these arrows and balls. Raises as `film`."""
        from quad_env.physics.rendering import Camera, Viewpoint

        env, look = self.step.env, self._look
        try:
            self._camera = self._camera or Camera(env.simulation.model, *look.size, look.camera)
            data = env.simulation.snapshot(0)
            x, y, z = data.body("base_link").xpos
            near = Viewpoint(
                110.0, -12.0, scale_to_robot(env.robot, NEAR, "m"), (x, y, z - env.robot.home_height / 3.0)
            )
            frame: NDArray[np.uint8] = self._camera.draw(data, arrows=marks, viewpoint=near)
        except ValueError:
            raise
        except Exception as error:  # whatever the graphics driver fails with
            raise UsageError(f"nothing can be drawn here ({type(error).__name__}: {error})") from error
        return frame

    def draw(self, last: bool) -> Image.Image:
        """The robot now, with its captions; at last with its outcome."""
        image = self.picture()
        text = captions.Text(self._look.font_size, edge=1)
        text.write(image, self._label, 0)
        if self._look.arrows:
            text.write(image, captions.motion(self._scene.velocity), 1, captions.ink(VELOCITY))
        words, ground = self._status_caption(last)
        if words:
            text.sign(image, words, ground)
        return image

    def _status_caption(self, last: bool) -> tuple[str, captions.Ink]:
        """What there is to say of the episode; no outcome of one that is too short to have one."""
        falls = self.recorder.falls
        outcome = str(metrics.outcome(self.recorder.episodes())[0]) if last and self._has_outcome else None
        if falls.fell[0]:
            fell = f"fell at {(falls.step[0] + 1) * self.step.env.dt:.2f} s: {falls.reason[0]}"
            return fell if outcome in (None, FELL, DIVERGED) else f"{outcome}, {fell}", ALARM
        if outcome is not None:
            return f"{outcome.replace('_', ' ')} ({SUCCESS_RULE})", GOOD if outcome == SUCCEEDED else BAD
        return ("pushed" if self._scene.pushed else ""), ALARM

    def close(self) -> None:
        """End the episode and free the renderer."""
        self._steps.close()
        if self._camera is not None:
            self._camera.close()
