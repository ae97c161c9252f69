"""The simulated robot on the network, as Unitree's SDK2 sees it: motor commands in, robot state out, at 500 Hz."""

import math
from dataclasses import dataclass

from live.commands.episode import ScenarioOptions
from live.commands.network import NetworkOptions
from live.unitree.low_level_robot import RATE, LowLevelRobot
from live.unitree.server import SimulatedUnitree
from quad_env.cli.interrupt import Interrupt
from quad_env.cli.launcher import raise_on_interrupt


@dataclass(frozen=True, kw_only=True)
class UnitreeOptions(NetworkOptions, ScenarioOptions):
    """Options of the command `unitree`, which simulates a robot on the network until Ctrl-C."""

    robot: str = "go2"
    """Robot: a name of quad_env.ROBOTS, or the path of an MJCF, URDF or TOML file."""
    seconds: float | None = None
    """Duration, simulated s; by default until Ctrl-C."""


def main(options: UnitreeOptions) -> int:
    """Run the command `unitree` with the given options, and return the exit code of the process."""
    options.check(seconds=(1.0 / RATE, 86_400.0))
    hardware, scenario = options.resolve()
    raise_on_interrupt()
    bus = options.connect()

    def log(text: str) -> None:
        print(f"{unitree.time:8.2f} s  {text}", flush=True)

    unitree = SimulatedUnitree(LowLevelRobot(hardware.robot_model, scenario, options.seed), bus, log)
    where = f"domain {options.domain} on {options.interface}"
    print(f"{hardware.robot_model.name} on {scenario.name}: {where}; Ctrl-C ends it", flush=True)
    try:
        with Interrupt() as interrupt:
            unitree.run(math.inf if options.seconds is None else options.seconds, interrupt)
    except KeyboardInterrupt:
        raise KeyboardInterrupt(f"{unitree.time:.1f} s simulated") from None
    finally:
        print(unitree.timing, flush=True)
        if unitree.guard.faults:
            print(f"rt/lowcmd: {format_faults(unitree.guard.faults)}", flush=True)
    return 0


def format_faults(faults: dict[str, int]) -> str:
    """Return the numbers of refused messages by kind of fault as text, such as `wrong CRC 3, stale 1`."""
    return ", ".join(f"{kind} {count}" for kind, count in faults.items())
