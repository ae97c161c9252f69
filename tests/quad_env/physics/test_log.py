"""MuJoCo writes no log of a diverging simulation into the working folder."""

import subprocess
import sys
from pathlib import Path

DIVERGING = """
import mujoco
import numpy as np
from quad_env.physics.simulation import Simulation
from quad_env.scenarios.scenario import Scenario
from quad_env.robots.simple_quad import SIMPLE_QUAD
from quad_env.scenarios.terrain import Flat

def diverge():
    simulation = Simulation(SIMPLE_QUAD, Scenario("made"))
    simulation.reset(np.arange(1), np.zeros((1, 35)))
    simulation.batch.bind("qvel")[0, 4] = 1e12
    simulation.step(np.zeros((1, 12)), None)
    assert simulation.read_coordinates()[1].all()

diverge()
config = mujoco.MjLogConfig.get()
config.logfile, config.logto_file = "chosen.txt", True
config.set()
diverge()
"""


def test_a_log_is_written_only_where_somebody_has_chosen_its_file(tmp_path: Path) -> None:
    subprocess.run([sys.executable, "-c", DIVERGING], cwd=tmp_path, check=True, capture_output=True)
    assert [file.name for file in tmp_path.iterdir()] == ["chosen.txt"]
