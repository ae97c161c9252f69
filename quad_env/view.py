"""The standing robot in MuJoCo's window; `python -m quad_env view` of an installation without policies."""

from dataclasses import dataclass

from quad_env.cli.command_line import UsageError
from quad_env.cli.pace import Pace
from quad_env.envs.env import SimpleQuadEnv
from quad_env.physics.rendering import Window, shows_windows
from quad_env.robots.named import robot_named


@dataclass(frozen=True)
class Options:
    """Show the standing robot in MuJoCo's window, from all sides; a clone of the project shows walking robots."""

    robot: str = "simple_quad"
    """Robot: a name of quad_env.ROBOTS, or the path of its MJCF, URDF or TOML."""


def main(options: Options) -> int:
    """Run the command until the window is closed; the exit code. Raises UsageError."""
    if not shows_windows():
        raise UsageError("view opens a window and needs a display")
    robot = robot_named(options.robot)
    env = SimpleQuadEnv(robot=robot.stiffer, terminate_on_fall=False)
    env.reset(seed=0)
    window = Window(env.model)
    try:
        pace = Pace(env.dt)
        while window.is_open:
            pace.wait()
            env.step(robot.home_pose)
            window.draw(env.data)
    finally:
        window.close()
    return 0
