"""Draws a frame of the robot: a program of its own, since a broken OpenGL may end a whole process.

`python -m quad_env.doctor.frame` prints the backend and exits with 0 where the frame shows something.
"""

import os
import sys


def main() -> int:
    """Draw it; the exit code."""
    from quad_env.envs.env import SimpleQuadEnv

    env = SimpleQuadEnv(render_mode="rgb_array", width=64, height=48)
    env.reset(seed=0)
    frame = env.render()
    backend = os.environ.get("MUJOCO_GL", "the display's own backend")
    env.close()
    print(backend)
    if frame is None or frame.std() < 1.0:
        print("the frame is empty", file=sys.stderr)
        return 1
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
