"""The simulated robot as a ROS node, in real time: driven by joint targets, or by --policy and velocities."""

import os
from contextlib import closing, nullcontext
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from evaluate.commands.options import Flag
from live.commands.episode import EpisodeOptions
from live.recording.recorder import check_recordable, recorder_for
from live.ros import interpreter
from live.ros.bridge import Bridge, JointTargetPolicy
from live.ros.ros_process import RosProcess
from live.session import Session
from policies.base import Policy
from quad_env.cli.interrupt import Interrupt
from quad_env.cli.launcher import raise_on_interrupt
from quad_env.cli.real_time_rate import RealTimeRate


@dataclass(frozen=True)
class RosOptions(EpisodeOptions):
    """Options of the command `ros`, which connects the simulated robot to ROS topics until Ctrl-C."""

    policy: str | None = None
    """Name or folder of the policy, which follows velocities on /cmd_vel; by default the joints follow
    joint targets on /position_controller/command."""
    real_time_factor: float = 1.0
    """Simulated time per wall time; the simulation is slower if this machine is too slow."""
    record: Path | None = None
    """MCAP file for a recording; it must not exist."""
    version: Literal["1", "2"] | None = None
    """Version of ROS; by default the version with a sourced setup file, otherwise the first version that is found."""
    network: Flag = False
    """Accept connections from other machines, as ROS_IP, ROS_MASTER_URI and ROS_DOMAIN_ID say. ROS has no passwords:
    everyone with access to the ports controls the robot. By default only this machine can connect."""


def main(options: RosOptions) -> int:
    """Run the command `ros` with the given options, and return the exit code of the process."""
    options.check(real_time_factor=(0.01, 100.0))
    if options.record is not None:
        check_recordable(options.record)
    version, python = interpreter.find(options.version)
    environment = interpreter.environment(os.environ, options.network)
    hardware, scenario = options.resolve()
    robot = hardware.robot_model
    policy: Policy = JointTargetPolicy(robot=robot)
    if options.policy is not None:
        policy = hardware.policy(options.policy, options.trust, on_hardware_profile=scenario.hardware)
    command = [python, "-m", "live.ros.node", version, *robot.joint_names]
    raise_on_interrupt()
    recording = nullcontext(None) if options.record is None else recorder_for(options.record, policy)
    with (
        closing(Session(policy, scenario, seed=options.seed, hardware=hardware)) as session,
        recording as recorder,
        closing(RosProcess(command, environment)) as ros_process,
    ):
        print(f"{robot.name} on {scenario.name}: {ros_process.wait_until_ready()}; Ctrl-C ends it", flush=True)
        if recorder is not None:
            session.observers.append(recorder)
        _run(session, ros_process, options.real_time_factor, options.record)
    return 0


def _run(session: Session, ros_process: RosProcess, speed: float, record: Path | None) -> None:
    """Simulate the robot in real time and exchange messages with the ROS process, until Ctrl-C.

    Args:
        session: Session with the simulated robot.
        ros_process: Process that publishes and receives ROS messages.
        speed: Simulated time per wall time.
        record: File of the recording, for the message at the end; None if there is no recording.

    Raises:
        KeyboardInterrupt: The user pressed Ctrl-C; the message has the simulated time.
    """

    def log(text: str) -> None:
        print(f"{bridge.time:8.2f} s  {text}", flush=True)

    real_time_rate = RealTimeRate(session.env.dt, speed)
    bridge = Bridge(session, log)
    session.listeners.append(log)
    try:
        with Interrupt() as interrupt:
            while True:
                interrupt.check()
                for packet in ros_process.received():
                    bridge.handle_message(packet["topic"], packet["values"], packet["size"])
                ros_process.send(bridge.step())
                real_time_rate.wait()
    except KeyboardInterrupt:
        recording = "" if record is None else f", all of it in {record}"
        raise KeyboardInterrupt(f"{bridge.time:.1f} s simulated{recording}") from None
