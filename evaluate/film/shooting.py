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
ALARM = (200, 30, 30)
"""Colour of a fall."""
GOOD = (0, 130, 90)
"""Colour of a success."""
BAD = (190, 110, 0)
"""Colour of a failure without a fall."""
Progress = Callable[[float], None]
"""Receives the completed part of the work, 0 … 1."""


@dataclass(frozen=True)
class FilmSpec:
    """Content of a film: policies next to each other in the same episode of a scenario."""

    policies: tuple[LabelledPolicy, ...]
    """Policies, one view each."""
    scenario: Scenario
    seed: int
    """Seed of the episode."""
    steps: int
    """Number of control steps."""
    title: str
    """Title above the frames."""
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
    """True if arrows are drawn."""

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


def film(spec: FilmSpec, path: Path, progress: Progress, options: RenderOptions = RenderOptions()) -> None:
    """Film an episode into a file, see `files`.

    A ValueError says that the camera does not exist or a policy is for another robot; a UsageError that nothing can be
    rendered here or the film is too long for its format; an OSError that the file cannot be written.

    Args:
        spec: Episode to film.
        path: File; its suffix selects the format.
        progress: Receives the completed part, 0 … 1.
        options: Appearance of the film.
    """
    if path.suffix.lower() == files.STRIP_SUFFIX:
        options = replace(options, rate=STRIP_RATE)
    frames = spec.steps // options.steps_per_frame + 1
    files.check_pixels(path, frames * len(spec.policies) * math.prod(options.size))
    with closing(render_frames(spec, options, lambda part: progress(RENDERING_SHARE * part))) as images:
        files.write_film(images, path, options.period)
    progress(1.0)


def render_frames(spec: FilmSpec, options: RenderOptions, progress: Progress) -> Generator[Image.Image]:
    """Render the frames of a film, until shortly after the last robot's fall.

    The last frame shows the outcome of each policy. Errors are the same as for `film`.

    Args:
        spec: Episode to film.
        options: Appearance of the film.
        progress: Receives the completed part, 0 … 1.

    Yields:
        Frames of equal size.
    """
    count = len(spec.policies)
    columns = count if count <= 3 else math.ceil(math.sqrt(count))
    with ExitStack() as stack:
        views = [stack.enter_context(closing(EpisodeView(policy, spec, options))) for policy in spec.policies]
        for number in range(spec.steps + 1):
            is_last = number == spec.steps or all(view.is_over for view in views)
            if is_last or number % options.steps_per_frame == 0:
                tiles = files.tile_images([view.draw(is_last) for view in views], columns)
                yield _add_header(tiles, spec, options, views[0].step, number)
                progress(number / spec.steps)
            if is_last:
                break
            for view in views:
                view.advance()
    progress(1.0)


def _add_header(tiles: Image.Image, spec: FilmSpec, options: RenderOptions, step: Step, number: int) -> Image.Image:
    """Put title, time and command, which all policies share, above the tiles."""
    text = captions.Text(options.font_size)
    frame = Image.new("RGB", (tiles.width, text.height(2) + tiles.height), captions.DARK)
    frame.paste(tiles, (0, text.height(2)))
    speed = "" if options.speed == 1.0 else f" at {options.speed:g} of real time"
    time_width = text.write(frame, f"{number * step.env.dt:.2f} s{speed}", 0, right=True)
    text.write(frame, spec.title, 0, taken=time_width)
    command = captions.format_velocity(step.infos["command"][0])
    text.write(frame, f"command {command}", 1, captions.text_colour(COMMAND))
    return frame


class EpisodeView:
    """One policy's part of a film, step by step, with its marks and captions; to be closed after use."""

    def __init__(self, policy: LabelledPolicy, spec: FilmSpec, options: RenderOptions) -> None:
        self._label = policy.label
        self._options = options
        self._num_steps = spec.steps
        self._camera: Any = None
        controller = policy.policy_for(spec.scenario)
        self.recorder = EpisodeRecorder(controller, np.array([spec.seed]), spec.steps)
        self._steps = iterate_episode(
            controller, spec.scenario, spec.seed, steps=spec.steps, command=spec.command, hardware=spec.hardware
        )
        self.step = next(self._steps)
        """Current control step."""
        self.recorder(self.step)
        self._scene = Scene(self.step)
        self._has_outcome = spec.steps > round(SETTLING_TIME / self.step.env.dt)

    def __iter__(self) -> Iterator[Step]:
        """Iterate over the start and the control steps until shortly after the fall."""
        yield self.step
        while not self.is_over and self.step.number < self._num_steps:
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
        if not falls.fell[0]:
            return False
        steps_since_fall = self.step.number - (falls.step[0] + 1)
        is_past_fall = steps_since_fall >= round(POST_FALL_TIME / self.step.env.dt)
        return bool(self.step.infos["diverged"][0] or is_past_fall)

    def picture(self) -> Image.Image:
        """Render the robot now, with marks if wanted; a fallen robot has a red frame."""
        marks = self._scene.marks() if self._options.arrows else ()
        image = Image.fromarray(self._frame(marks))
        if marks and self.recorder.falls.fell[0]:
            border = (0, 0, *np.subtract(image.size, 1))
            ImageDraw.Draw(image).rectangle(border, outline=ALARM, width=image.height // 60)
        return image

    def _frame(self, marks: Sequence[Arrow | Ball]) -> NDArray[np.uint8]:
        """Render the robot now, with these arrows and balls. Raises as `film`."""
        from quad_env.physics.rendering import Camera, Viewpoint

        env = self.step.env
        try:
            self._camera = self._camera or Camera(env.simulation.model, *self._options.size, self._options.camera)
            data = env.simulation.snapshot(0)
            x, y, z = data.body("base_link").xpos
            distance = scale_to_robot(env.robot, FREE_CAMERA_DISTANCE, "m")
            viewpoint = Viewpoint(110.0, -12.0, distance, (x, y, z - env.robot.home_height / 3.0))
            frame: NDArray[np.uint8] = self._camera.draw(data, arrows=marks, viewpoint=viewpoint)
        except ValueError:
            raise
        except Exception as error:  # whatever the graphics driver fails with
            raise UsageError(f"nothing can be drawn here ({type(error).__name__}: {error})") from error
        return frame

    def draw(self, last: bool) -> Image.Image:
        """Render the robot now with its captions; the `last` frame has the outcome."""
        image = self.picture()
        text = captions.Text(self._options.font_size, edge=1)
        text.write(image, self._label, 0)
        if self._options.arrows:
            velocity = captions.format_velocity(self._scene.velocity)
            text.write(image, velocity, 1, captions.text_colour(VELOCITY))
        status, ground = self._status_caption(last)
        if status:
            text.write_banner(image, status, ground)
        return image

    def _status_caption(self, last: bool) -> tuple[str, captions.Ink]:
        """Return the caption on the state of the episode and its colour; a short episode has no outcome."""
        falls = self.recorder.falls
        outcome = str(metrics.outcome(self.recorder.episodes())[0]) if last and self._has_outcome else None
        if falls.fell[0]:
            fall = f"fell at {(falls.step[0] + 1) * self.step.env.dt:.2f} s: {falls.reason[0]}"
            return fall if outcome in (None, FELL, DIVERGED) else f"{outcome}, {fall}", ALARM
        if outcome is not None:
            return f"{outcome.replace('_', ' ')} ({SUCCESS_RULE})", GOOD if outcome == SUCCEEDED else BAD
        return ("pushed" if self._scene.is_push_shown else ""), ALARM

    def close(self) -> None:
        """End the episode and free the renderer."""
        self._steps.close()
        if self._camera is not None:
            self._camera.close()
