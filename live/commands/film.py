"""Film an episode: `python -m quad_env film walk.mp4 --policies trot residual`, the policies side by side.

A green arrow shows the command, a yellow one the mean velocity of the last half second, a red one a push.
"""

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal

import tyro

from evaluate.cells import load_labelled_policy
from evaluate.film import files
from evaluate.film.shooting import FilmSpec, RenderOptions, film
from evaluate.hardware import IDEAL
from live.commands.episode import Command, EpisodeOptions
from policies.base import CONTROL_PERIOD
from quad_env.cli.command_line import UsageError
from quad_env.cli.launcher import raise_on_interrupt
from quad_env.cli.progress import show_bar

MAX_POLICIES = 9
"""Maximum number of policies that a film shows side by side."""
LIMITS = {"seconds": (CONTROL_PERIOD, 86_400.0), "speed": (0.01, 100.0), "fps": (1.0, 100.0), "size": (64, 4096)}
"""Name of an option of the command `film` -> smallest and largest valid value, in the unit of the option."""


@dataclass(frozen=True)
class FilmOptions(EpisodeOptions):
    """Options of the command `film`, which films an episode, until one second after a fall."""

    out: Annotated[Path, tyro.conf.Positional]
    """File to write: .mp4 (extra `video`), .webp, .gif, or .png for a strip of frames; an existing file is replaced."""
    policies: tuple[str, ...] = ("residual",)
    """Names, folders or files of policies; several are shown side by side."""
    seconds: float = 10.0
    """Duration of the episode, simulated s."""
    command: Command | None = None
    """Constant command: forward m/s, left m/s, yaw rate rad/s; by default the scenario draws commands."""
    speed: float = 1.0
    """Playback speed of the film: 1 is real time, 0.25 is slow motion."""
    fps: float = 25.0
    """Approximate frame rate, 1/s; the time between two frames is a whole number of control steps."""
    size: tuple[int, int] = (640, 480)
    """Width and height of the image of each robot, pixels."""
    camera: Literal["track", "side"] = "track"
    """View of the camera, which follows the robot."""
    arrows: bool = True
    """Draw arrows for command, velocity and pushes."""


def main(options: FilmOptions) -> int:
    """Run the command `film` with the given options, and return the exit code of the process."""
    options.check(**LIMITS)
    if not 1 <= len(options.policies) <= MAX_POLICIES:
        raise UsageError(f"--policies must name 1 to {MAX_POLICIES}, not {len(options.policies)}")
    hardware, scenario = options.resolve()
    policies = tuple(load_labelled_policy(name, hardware, (scenario,), options.trust) for name in options.policies)
    robot = "" if hardware == IDEAL else f"{hardware.robot_model.name}, "
    title = f"{robot}{scenario.name}, seed {options.seed}"
    steps = round(options.seconds / CONTROL_PERIOD)
    spec = FilmSpec(policies, scenario, options.seed, steps, title, hardware, options.command)
    render_options = RenderOptions(options.size, options.camera, options.speed, options.fps, options.arrows)
    files.check_film_path(options.out, "the film")
    raise_on_interrupt()
    with show_bar("filming") as progress:
        try:
            film(spec, options.out, progress, render_options)
        except OSError as error:
            raise UsageError(f"cannot write {options.out} ({error.strerror or error})") from error
    print(options.out)
    return 0
