"""Record an episode: `python -m quad_env record walk.mcap`, for Foxglove and `ros2 bag play`."""

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import numpy as np
import tyro

from evaluate.rollouts.observers import Step
from evaluate.rollouts.rollout import roll_out
from live.commands.episode import Command, EpisodeOptions
from live.recording.recorder import check_recordable, recorder_for
from policies.base import CONTROL_PERIOD
from quad_env.cli.launcher import raise_on_interrupt
from quad_env.cli.progress import show_bar


@dataclass(frozen=True)
class RecordOptions(EpisodeOptions):
    """Options of the command `record`, which records an episode; the recording continues after a fall."""

    out: Annotated[Path, tyro.conf.Positional]
    """MCAP file to write, for example walk.mcap; it must not exist."""
    policy: str = "residual"
    """Name of the policy, or folder of a trained policy."""
    seconds: float = 10.0
    """Duration of the episode, simulated s."""
    command: Command | None = None
    """Constant command: forward m/s, left m/s, yaw rate rad/s; by default the scenario draws commands."""


def main(options: RecordOptions) -> int:
    """Run the command `record` with the given options, and return the exit code of the process."""
    options.check(seconds=(CONTROL_PERIOD, 86_400.0))
    check_recordable(options.out)
    hardware, scenario = options.resolve()
    policy = hardware.policy(options.policy, options.trust, on_hardware_profile=scenario.hardware)
    steps = round(options.seconds / CONTROL_PERIOD)
    raise_on_interrupt()
    recorded_steps = 0
    with show_bar("recording") as progress, recorder_for(options.out, policy) as recorder:

        def show_progress(step: Step) -> None:
            nonlocal recorded_steps
            recorded_steps = step.number
            progress(step.number / steps)

        try:
            roll_out(
                policy,
                scenario,
                np.array([options.seed]),
                recorder,
                show_progress,
                steps=steps,
                command=options.command,
                terminate_on_fall=False,
                hardware=hardware,
            )
        except KeyboardInterrupt:
            raise KeyboardInterrupt(
                f"{options.out} has the {recorded_steps * CONTROL_PERIOD:.1f} s until now"
            ) from None
    print(f"{options.out}: {recorded_steps * CONTROL_PERIOD:.1f} s of {options.policy} on {scenario.name}")
    return 0
