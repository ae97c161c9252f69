"""Pictures of policies walking: `python -m research pictures` draws strips of frames, one row a policy and scenario.

Look at the robot before believing a figure. With `--scenarios flat rough --out docs/walking.webp` the policies move
side by side; with `--robots simple_quad go1 go2 --policies residual` too, the robots do, as in the README.
"""

from contextlib import closing
from dataclasses import dataclass
from pathlib import Path

from PIL import Image

import quad_env
from evaluate.film.captions import Text
from evaluate.film.files import moving_picture, tiled
from evaluate.film.shooting import Filming, Frame
from evaluate.rollouts.hardware import Hardware, hardware_of
from evaluate.rollouts.rollout import watch
from policies.base import CONTROL_PERIOD
from quad_env.cli.command_line import UsageError
from quad_env.files.writing import make_writable_folder, write_atomically
from quad_env.robots.similarity import scaled

EPISODE = 10.0
"""Length of an episode, s."""
WIDTH, HEIGHT = 240, 200
"""Pixels of a frame."""
SAMPLES = 2
"""Pixels drawn across and down for each that is shown: edges are smooth then."""
LETTERS = 17
"""Size of a label's letters, pixels."""
QUALITY = 30
"""Quality of a moving WebP, out of 100."""
MOVING = (".webp", ".gif")


@dataclass(frozen=True)
class Options:
    """Draw policies walking."""

    policies: tuple[str, ...] = ("document_repaired", "trot", "trot_feedback", "robust")
    """Names of policies, folders of trained ones, or files, as of python -m evaluate."""
    scenarios: tuple[str, ...] = ("flat", "push", "rough")
    """Names of scenarios."""
    out: Path = Path("results/walking.png")
    """PNG to write, of strips; or WebP or GIF, of the policies moving side by side, a row a scenario."""
    robots: tuple[str, ...] = (Hardware.robot,)
    """Robots side by side, names of quad_env.ROBOTS or paths of their MJCF, URDF or TOML; all with every policy."""
    command: tuple[float, float, float] = (0.7, 0.0, 0.0)
    """Forward m/s, lateral m/s, yaw rate rad/s of SimpleQuad; of another robot what is as fast for its size."""
    start: float = 2.0
    """Time of the first frame, s."""
    every: float | None = None
    """Time between frames, s; by default 0.06 of a strip, 0.05 of a moving picture, which is shown in real time."""
    frames: int | None = None
    """Frames (count); by default 8 of a strip, 60 of a moving picture."""
    seed: int = 0
    """Seed of the episode."""

    @property
    def moving(self) -> bool:
        """Whether the picture is to move."""
        return self.out.suffix.lower() in MOVING

    @property
    def period(self) -> float:
        """Time between frames, s."""
        return self.every if self.every is not None else 0.05 if self.moving else 0.06

    @property
    def count(self) -> int:
        """How many frames."""
        return self.frames if self.frames is not None else 60 if self.moving else 8


def main(options: Options) -> int:
    """Draw the strips; the exit code."""
    _check(options)
    draw(options)
    print(options.out)
    return 0


def _check(options: Options) -> None:
    """Everything that can be wrong, before anything is drawn; ValueError (PolicyError), OSError or UsageError."""
    if not (options.count >= 1 and options.period >= CONTROL_PERIOD and options.start >= 0.0):
        raise UsageError(f"--frames must be at least 1, --every at least {CONTROL_PERIOD:g} s, --start not negative")
    if not options.start + options.count * options.period <= EPISODE:
        raise UsageError(f"the last frame must lie within the episode's {EPISODE:g} s; see --start, --every, --frames")
    if not options.policies or not options.scenarios or not options.robots:
        raise UsageError("--policies, --scenarios and --robots must each name at least one")
    for hardware in (hardware_of(robot, "--robots") for robot in options.robots):
        for policy in options.policies:
            hardware.policy(policy)
        try:
            for scenario in options.scenarios:
                quad_env.scenario(scenario, hardware.quadruped)
        except ValueError as error:
            raise UsageError(f"--scenarios: {error}") from error
    if options.out.suffix.lower() not in (".png", *MOVING) or options.out.is_dir():
        raise UsageError(f"--out must be a .png, or a .webp or .gif that moves, not {options.out}")
    make_writable_folder(options.out.parent)


def draw(options: Options) -> None:
    """Write the picture."""
    columns = [(Hardware(robot=robot), policy) for robot in options.robots for policy in options.policies]
    walks = [walk(*column, scenario, options) for scenario in options.scenarios for column in columns]
    if options.moving:
        images = [tiled(tiles, len(columns)) for tiles in zip(*walks, strict=True)]
        kind = options.out.suffix[1:].lower()
        write_atomically(options.out, moving_picture(images, kind, options.period, quality=QUALITY))
    else:
        tiled([image for images in walks for image in images], options.count).save(options.out)


def walk(hardware: Hardware, policy: str, scenario: str, options: Options) -> list[Image.Image]:
    """Frames of one episode, with its name on the first, or on all that are to move; a fallen robot lies there."""
    units = zip(options.command, ("m/s", "m/s", "rad/s"), strict=True)
    command = [scaled(hardware.quadruped, value, unit) for value, unit in units]
    first, every = (round(time / CONTROL_PERIOD) for time in (options.start + CONTROL_PERIOD, options.period))
    length, taken = first + (options.count - 1) * every, list[Frame]()
    steps = watch(hardware.policy(policy), scenario, options.seed, steps=length, command=command, hardware=hardware)
    with closing(Filming((SAMPLES * WIDTH, SAMPLES * HEIGHT))) as filming, closing(steps):
        for step in steps:
            due = step.number >= first and (step.number - first) % every == 0
            if due or step.infos["diverged"][0]:  # where it diverges, the frames that are left are the last one
                taken.append(filming.draw(step.env))
    taken += taken[-1:] * (options.count - len(taken))
    robots, several = len(options.robots) > 1, len(options.policies) > 1
    called = [Path(hardware.robot).stem] * robots + [policy] * (several or not robots)
    label = ", ".join((*called, scenario))
    images = [Image.fromarray(frame).reduce(SAMPLES) for frame in taken]  # with smooth edges
    for image in images if options.moving else images[:1]:
        Text(LETTERS, edge=1).write(image, label, 0)
    return images
