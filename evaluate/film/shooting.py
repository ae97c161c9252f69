"""Rendering of films: one or more policies in the same episode, with captions, arrows and balls."""

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
"""Time for which a film continues after the robot has fallen, s."""
FREE_CAMERA_DISTANCE = 1.8
"""Distance between the free camera and the trunk, m.

The value is valid for the robot SimpleQuad, and is scaled to the size of other robots.
"""
RENDERING_SHARE = 0.8
"""Fraction of the progress bar for simulation and rendering of a film; the rest is for writing the file."""
STRIP_RATE = 5.0
"""Frame rate of a film from which the frames of a strip (PNG image with several frames) are chosen, 1/s."""
ALARM = (200, 30, 30)
"""Colour of the border and the caption after a fall, and of the caption during a push: red, green, blue, 0 … 255."""
GOOD = (0, 130, 90)
"""Colour of the caption of a successful episode: red, green, blue, 0 … 255."""
BAD = (190, 110, 0)
"""Colour of the caption of a failed episode in which the robot stays upright: red, green, blue, 0 … 255."""
Progress = Callable[[float], None]
"""Function that receives the completed fraction of the work, 0 … 1, and shows it."""


@dataclass(frozen=True)
class FilmSpec:
    """Content of a film: one or more policies, each in the same episode of a scenario."""

    policies: tuple[LabelledPolicy, ...]
    """Policies to film; the robot of each policy has its own part of the frame."""
    scenario: Scenario
    """Scenario of the filmed episode."""
    seed: int
    """Seed of the filmed episode."""
    steps: int
    """Maximum number of control steps of the filmed episode."""
    title: str
    """Title that is written above the images of the robots."""
    hardware: HardwareConfig = IDEAL
    """Names of robot, servo gains, motor model, sensor model, state estimator and simulator."""
    command: tuple[float, float, float] | None = None
    """Constant command: forward and leftward velocity, m/s, and yaw rate, rad/s.

    If it is None, the commands of the scenario are used.
    """


@dataclass(frozen=True)
class RenderOptions:
    """Appearance of a film: image size, camera, speed, frame rate and marks."""

    size: tuple[int, int] = (640, 480)
    """Width and height of the image of each robot, pixels."""
    camera: str | None = "track"
    """Name of a camera in the MuJoCo model of the robot.

    If it is None, a free camera near the left side of the robot is used. The free camera renders faster, because it
    draws no shadows.
    """
    speed: float = 1.0
    """Playback speed: 1 is real time, less than 1 is slow motion."""
    rate: float = 25.0
    """Requested frame rate, 1/s; it is rounded so that a frame lasts a whole number of control steps."""
    arrows: bool = True
    """True to draw the arrows of velocity, command and push, and the balls at the feet."""

    @property
    def steps_per_frame(self) -> int:
        """Number of control steps between two frames, from speed, frame rate and control period."""
        return max(1, round(self.speed / (self.rate * CONTROL_PERIOD)))

    @property
    def period(self) -> float:
        """Time for which a frame of the film is displayed, s."""
        return self.steps_per_frame * CONTROL_PERIOD / self.speed

    @property
    def font_size(self) -> int:
        """Font size of the captions, pixels."""
        return max(captions.MIN_FONT_SIZE, min(self.size) // 30)


def film(spec: FilmSpec, path: Path, progress: Progress, options: RenderOptions = RenderOptions()) -> None:
    """Simulate and film an episode, and write the film to a file (MP4, WebP, GIF or PNG).

    ValueError is raised if the camera does not exist or if a policy is for another robot. UsageError is raised if this
    machine cannot render or if the film is too long for its format. OSError is raised if the file cannot be written.

    Args:
        spec: Episode and policies to film.
        path: File to write; its suffix selects the format.
        progress: Function that receives the completed fraction of the work, 0 … 1.
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
    """Render the frames of a film until all robots have fallen, or until the end of the episode.

    The film continues for POST_FALL_TIME after the last fall. The last frame shows the outcome of the episode of each
    policy. ValueError is raised if the camera does not exist or if a policy is for another robot. UsageError is raised
    if this machine cannot render.

    Args:
        spec: Episode and policies to film.
        options: Appearance of the film.
        progress: Function that receives the completed fraction of the work, 0 … 1.

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
    """Return the images of all robots with a header above them: title, time and commanded velocity.

    Args:
        tiles: Image that contains the images of all robots.
        spec: Episode and policies of the film.
        options: Appearance of the film.
        step: Control step that the frame shows.
        number: Number of the control step.

    Returns:
        Image with the header.
    """
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
    """Simulation and images of one policy in a film, control step by control step.

    The caller must call `close` after use.
    """

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
        """Control step that has been simulated last."""
        self.recorder(self.step)
        self._scene = Scene(self.step)
        self._has_outcome = spec.steps > round(SETTLING_TIME / self.step.env.dt)

    def __iter__(self) -> Iterator[Step]:
        """Iterate over the control steps of the film, from the start of the episode to shortly after a fall."""
        yield self.step
        while not self.is_over and self.step.number < self._num_steps:
            self.advance()
            yield self.step

    def advance(self) -> None:
        """Simulate one more control step; nothing changes if the simulation has diverged."""
        step = next(self._steps, None)
        if step is not None:
            self.step = step
            self.recorder(step)
            self._scene.advance(step)

    @property
    def is_over(self) -> bool:
        """True if the film of this robot has ended: after a divergence, or POST_FALL_TIME after a fall.

        A divergence is an unstable simulation.
        """
        falls = self.recorder.falls
        if not falls.fell[0]:
            return False
        steps_since_fall = self.step.number - (falls.step[0] + 1)
        is_past_fall = steps_since_fall >= round(POST_FALL_TIME / self.step.env.dt)
        return bool(self.step.infos["diverged"][0] or is_past_fall)

    def picture(self) -> Image.Image:
        """Render the current state of the robot, with arrows and balls if `options.arrows` is set.

        After a fall, an image with arrows and balls has a red border.
        """
        marks = self._scene.marks() if self._options.arrows else ()
        image = Image.fromarray(self._frame(marks))
        if marks and self.recorder.falls.fell[0]:
            border = (0, 0, *np.subtract(image.size, 1))
            ImageDraw.Draw(image).rectangle(border, outline=ALARM, width=image.height // 60)
        return image

    def _frame(self, marks: Sequence[Arrow | Ball]) -> NDArray[np.uint8]:
        """Render the current state of the robot with the given arrows and balls.

        Args:
            marks: Arrows and balls to draw.

        Returns:
            Image, (height, width, 3), red, green and blue, 0 … 255.

        Raises:
            ValueError: The camera does not exist.
            UsageError: This machine has no working renderer.
        """
        from quad_env.physics.rendering import Camera, Viewpoint

        env = self.step.env
        try:
            self._camera = self._camera or Camera(env.simulation.drawn_model, *self._options.size, self._options.camera)
            data = env.simulation.drawn_snapshot(0)
            x, y, z = data.body("base_link").xpos
            distance = scale_to_robot(env.robot, FREE_CAMERA_DISTANCE, "m")
            viewpoint = Viewpoint(110.0, -12.0, distance, (x, y, z - env.robot.home_height / 3.0))
            frame: NDArray[np.uint8] = self._camera.draw(data, arrows=marks, viewpoint=viewpoint)
        except ValueError:
            raise
        except Exception as error:  # All types are caught, because a graphics driver may raise any type.
            raise UsageError(f"nothing can be drawn here ({type(error).__name__}: {error})") from error
        return frame

    def draw(self, last: bool) -> Image.Image:
        """Render the current state of the robot with captions.

        Args:
            last: True for the last frame of the film, which shows the outcome of the episode.

        Returns:
            The image.
        """
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
        """Return the text and the colour of the caption for the state of the episode.

        The text is empty while the robot walks normally. The caption of the last frame is the outcome of the episode.
        An episode that is shorter than the first second, which no measure counts, has no outcome.

        Args:
            last: True for the last frame of the film.

        Returns:
            Text and colour.
        """
        falls = self.recorder.falls
        outcome = str(metrics.outcome(self.recorder.episodes())[0]) if last and self._has_outcome else None
        if falls.fell[0]:
            fall = f"fell at {(falls.step[0] + 1) * self.step.env.dt:.2f} s: {falls.reason[0]}"
            return fall if outcome in (None, FELL, DIVERGED) else f"{outcome}, {fall}", ALARM
        if outcome is not None:
            return f"{outcome.replace('_', ' ')} ({SUCCESS_RULE})", GOOD if outcome == SUCCEEDED else BAD
        return ("pushed" if self._scene.is_push_shown else ""), ALARM

    def close(self) -> None:
        """End the simulation, and free the memory of the renderer."""
        self._steps.close()
        if self._camera is not None:
            self._camera.close()
