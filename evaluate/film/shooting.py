"""Frames of a film: one episode of one or more policies next to each other, with captions and marks."""

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
from evaluate.rollouts.rollout import EpisodeRecorder, iterate_episode
from policies.base import CONTROL_PERIOD
from quad_env.cli.command_line import UsageError
from quad_env.physics.arrows import Arrow, Ball
from quad_env.robots.similarity import scale_to_robot
from quad_env.scenarios.scenario import Scenario

POST_FALL_TIME = 1.0
"""s. Time that is shown after a fall."""
FREE_CAMERA_DISTANCE = 1.8
"""m. Distance of a free camera from SimpleQuad's trunk."""
RENDERING_SHARE = 0.8
"""Part of the work of a film for simulation and rendering; the rest writes the file."""
STRIP_RATE = 5.0
"""Frames per second from which the frames of a strip are chosen."""
ALARM, GOOD, BAD = (200, 30, 30), (0, 130, 90), (190, 110, 0)
Progress = Callable[[float], None]
"""Receives the completed part of the work, 0 … 1."""


@dataclass(frozen=True)
class FilmSpec:
    """Content of a film: policies next to each other in the same episode of a scenario."""

    policies: tuple[LabelledPolicy, ...]
    scenario: Scenario
    seed: int
    steps: int
    """Number of control steps."""
    title: str
    hardware: HardwareConfig = IDEAL
    command: tuple[float, float, float] | None = None
    """Command of the whole episode, m/s, m/s, rad/s; None: the scenario draws commands."""


@dataclass(frozen=True)
class RenderOptions:
    """Appearance of a film."""

    size: tuple[int, int] = (640, 480)
    """Width and height of each robot's frames, pixels."""
    camera: str | None = "track"
    """Camera of the model; None: a free one near the robot's left side, faster and without shadows."""
    speed: float = 1.0
    """Film time over real time: 1 is real time, less is slow motion."""
    rate: float = 25.0
    """Approximate frames per second; a whole number of control steps lies between two frames."""
    arrows: bool = True
    """Whether arrows are drawn."""

    @property
    def steps_per_frame(self) -> int:
        """Number of control steps from one frame to the next."""
        return max(1, round(self.speed / (self.rate * CONTROL_PERIOD)))

    @property
    def period(self) -> float:
        """Display time of a frame, s."""
        return self.steps_per_frame * CONTROL_PERIOD / self.speed

    @property
    def font_size(self) -> int:
        """Font size of the captions, pixels."""
        return max(captions.MIN_FONT_SIZE, min(self.size) // 30)


def film(spec: FilmSpec, path: Path, progress: Progress, look: RenderOptions = RenderOptions()) -> None:
    """Film an episode into a file, see `files`.

    A ValueError says that the camera does not exist or a policy is for another robot; a UsageError that nothing can be
    rendered here or the film is too long for its format; an OSError that the file cannot be written.

    Args:
        spec: Episode to film.
        path: File; its suffix selects the format.
        progress: Receives the completed part, 0 … 1.
        look: Appearance of the film.
    """
    if path.suffix.lower() == files.STRIP_SUFFIX:
        look = replace(look, rate=STRIP_RATE)
    files.check_pixels(path, (spec.steps // look.steps_per_frame + 1) * len(spec.policies) * math.prod(look.size))
    with closing(render_frames(spec, look, lambda share: progress(RENDERING_SHARE * share))) as images:
        files.write_film(images, path, look.period)
    progress(1.0)


def render_frames(spec: FilmSpec, look: RenderOptions, progress: Progress) -> Generator[Image.Image]:
    """Render the frames of a film, until shortly after the last robot's fall.

    The last frame shows the outcome of each policy. Errors are the same as for `film`.

    Args:
        spec: Episode to film.
        look: Appearance of the film.
        progress: Receives the completed part, 0 … 1.

    Yields:
        Frames of equal size.
    """
    count = len(spec.policies)
    columns = count if count <= 3 else math.ceil(math.sqrt(count))
    with ExitStack() as stack:
        panels = [stack.enter_context(closing(EpisodeView(policy, spec, look))) for policy in spec.policies]
        for number in range(spec.steps + 1):
            over = number == spec.steps or all(panel.is_over for panel in panels)
            if over or number % look.steps_per_frame == 0:
                tiles = files.tile_images([panel.draw(over) for panel in panels], columns)
                yield _add_header(tiles, spec, look, panels[0].step, number)
                progress(number / spec.steps)
            if over:
                break
            for panel in panels:
                panel.advance()
    progress(1.0)


def _add_header(tiles: Image.Image, spec: FilmSpec, look: RenderOptions, step: Step, number: int) -> Image.Image:
    """Put title, time and command, which all policies share, above the tiles."""
    text = captions.Text(look.font_size)
    out = Image.new("RGB", (tiles.width, text.height(2) + tiles.height), captions.DARK)
    out.paste(tiles, (0, text.height(2)))
    slowed = "" if look.speed == 1.0 else f" at {look.speed:g} of real time"
    room = text.write(out, f"{number * step.env.dt:.2f} s{slowed}", 0, right=True)
    text.write(out, spec.title, 0, taken=room)
    text.write(out, f"command {captions.format_velocity(step.infos['command'][0])}", 1, captions.text_colour(COMMAND))
    return out


class EpisodeView:
    """One policy's part of a film, step by step, with its marks and captions; to be closed after use."""

    def __init__(self, policy: LabelledPolicy, spec: FilmSpec, look: RenderOptions) -> None:
        self._label, self._look, self._count = policy.label, look, spec.steps
        self._camera: Any = None
        walker = policy.policy_for(spec.scenario)
        self.recorder = EpisodeRecorder(walker, np.array([spec.seed]), spec.steps)
        where = walker, spec.scenario, spec.seed
        self._steps = iterate_episode(*where, steps=spec.steps, command=spec.command, hardware=spec.hardware)
        self.step = next(self._steps)
        """The control step that the episode is at."""
        self.recorder(self.step)
        self._scene = Scene(self.step)
        self._has_outcome = spec.steps > round(SETTLING_TIME / self.step.env.dt)

    def __iter__(self) -> Iterator[Step]:
        """Iterate over the start and the control steps until shortly after the fall."""
        yield self.step
        while not self.is_over and self.step.number < self._count:
            self.advance()
            yield self.step

    def advance(self) -> None:
        """Simulate a control step; a diverged robot keeps its state."""
        step = next(self._steps, None)
        if step is not None:
            self.step = step
            self.recorder(step)
            self._scene.advance(step)

    @property
    def is_over(self) -> bool:
        """True if the episode has nothing more to show."""
        falls = self.recorder.falls
        past = self.step.number - (falls.step[0] + 1)
        return bool(
            falls.fell[0] and (self.step.infos["diverged"][0] or past >= round(POST_FALL_TIME / self.step.env.dt))
        )

    def picture(self) -> Image.Image:
        """Render the robot now, with marks if wanted; a fallen robot has a red frame."""
        marks = self._scene.marks() if self._look.arrows else ()
        image = Image.fromarray(self._frame(marks))
        if marks and self.recorder.falls.fell[0]:
            ImageDraw.Draw(image).rectangle(
                (0, 0, *np.subtract(image.size, 1)), outline=ALARM, width=image.height // 60
            )
        return image

    def _frame(self, marks: Sequence[Arrow | Ball]) -> NDArray[np.uint8]:
        """Render the robot now, with these arrows and balls. Raises as `film`."""
        from quad_env.physics.rendering import Camera, Viewpoint

        env, look = self.step.env, self._look
        try:
            self._camera = self._camera or Camera(env.simulation.model, *look.size, look.camera)
            data = env.simulation.snapshot(0)
            x, y, z = data.body("base_link").xpos
            near = Viewpoint(
                110.0,
                -12.0,
                scale_to_robot(env.robot, FREE_CAMERA_DISTANCE, "m"),
                (x, y, z - env.robot.home_height / 3.0),
            )
            frame: NDArray[np.uint8] = self._camera.draw(data, arrows=marks, viewpoint=near)
        except ValueError:
            raise
        except Exception as error:  # whatever the graphics driver fails with
            raise UsageError(f"nothing can be drawn here ({type(error).__name__}: {error})") from error
        return frame

    def draw(self, last: bool) -> Image.Image:
        """Render the robot now with its captions; the `last` frame has the outcome."""
        image = self.picture()
        text = captions.Text(self._look.font_size, edge=1)
        text.write(image, self._label, 0)
        if self._look.arrows:
            text.write(image, captions.format_velocity(self._scene.velocity), 1, captions.text_colour(VELOCITY))
        words, ground = self._status_caption(last)
        if words:
            text.write_banner(image, words, ground)
        return image

    def _status_caption(self, last: bool) -> tuple[str, captions.Ink]:
        """Return the caption on the state of the episode and its colour; a short episode has no outcome."""
        falls = self.recorder.falls
        outcome = str(metrics.outcome(self.recorder.episodes())[0]) if last and self._has_outcome else None
        if falls.fell[0]:
            fell = f"fell at {(falls.step[0] + 1) * self.step.env.dt:.2f} s: {falls.reason[0]}"
            return fell if outcome in (None, FELL, DIVERGED) else f"{outcome}, {fell}", ALARM
        if outcome is not None:
            return f"{outcome.replace('_', ' ')} ({SUCCESS_RULE})", GOOD if outcome == SUCCEEDED else BAD
        return ("pushed" if self._scene.is_push_shown else ""), ALARM

    def close(self) -> None:
        """End the episode and free the renderer."""
        self._steps.close()
        if self._camera is not None:
            self._camera.close()
