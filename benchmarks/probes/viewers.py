"""Other viewers with the same robot walking in real time: `python -m benchmarks.probes.viewers studio PORT`."""

import sys
from collections.abc import Callable
from contextlib import closing

import mujoco

import policies
from live.pace import Pace
from live.session import Session

EVERY = 3
"""Control steps between two states that are handed to the viewer: 33 a second."""


def walk(show: Callable[[mujoco.MjModel, mujoco.MjData], None]) -> None:
    """Have a residual walk ahead for ever, shown to that viewer."""
    with closing(Session([policies.make("residual")], "flat")) as session:
        session.steer((0.5, 0.0, 0.0))
        simulation, pace = session.env.simulation, Pace(session.env.dt)
        while True:
            pace.wait()
            if session.step().number % EVERY == 0:
                show(simulation.model, simulation.snapshot(0))


def studio(port: int) -> None:
    """MuJoCo's own viewer in the browser, with no panels."""
    from mujoco.studio import launch_web, viewer_protocol

    with launch_web.launch(viewer_protocol.ViewerConfig(gfx="web", http_port=port)) as handle:
        walk(lambda model, data: handle.sync(model, data) and None)


def mjviser(port: int) -> None:
    """mjviser's scene in viser."""
    import viser
    from mjviser import ViserMujocoScene

    server = viser.ViserServer(host="127.0.0.1", port=port, verbose=False)
    scenes: dict[int, ViserMujocoScene] = {}

    def show(model: mujoco.MjModel, data: mujoco.MjData) -> None:
        if not scenes:
            scenes[0] = ViserMujocoScene(server, model, num_envs=1)
        scenes[0].update_from_mjdata(data)

    walk(show)


VIEWERS = {"studio": studio, "mjviser": mjviser}

if __name__ == "__main__":
    VIEWERS[sys.argv[1]](int(sys.argv[2]))
