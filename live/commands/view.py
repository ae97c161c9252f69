"""Watch and steer robots in the browser: `python -m quad_env view`, on this machine alone."""

import threading
import webbrowser
from contextlib import closing
from dataclasses import dataclass

from live.commands.episode import Command, EpisodeOptions
from live.view.controller import ViewController
from live.view.loop import LiveView
from live.view.requests import MAX_ROBOTS, MAX_SEED
from quad_env.cli.command_line import UsageError
from quad_env.cli.launcher import raise_on_interrupt
from quad_env.physics.rendering import has_display


@dataclass(frozen=True)
class ViewOptions(EpisodeOptions):
    """Options of the command `view`, which shows robots in a browser until Ctrl-C."""

    policy: tuple[str, ...] = ("residual",)
    """Name, folder or file of a policy; several policies are shown side by side in the same episode."""
    command: Command | None = (0.0, 0.0, 0.0)
    """Initial command: forward m/s, left m/s, yaw rate rad/s; with None the scenario draws commands."""
    port: int | None = None
    """Port of the server, 0 for any free port; by default 8080, or any free port if 8080 is in use."""
    browser: bool = True
    """Open the page in a browser if this machine has a display."""


def main(options: ViewOptions) -> int:
    """Run the command `view` with the given options, and return the exit code of the process."""
    options.check(seed=(0, MAX_SEED))
    if not 1 <= len(options.policy) <= MAX_ROBOTS:
        raise UsageError(f"--policy takes 1 to {MAX_ROBOTS} policies, not {len(options.policy)}")
    if options.port is not None and not 0 <= options.port < 65_536:
        raise UsageError(f"--port must be from 0 to 65535, not {options.port}")
    hardware, _ = options.resolve()
    raise_on_interrupt()
    try:
        controller = ViewController(
            options.policy, options.scenario, hardware, seed=options.seed, command=options.command, trust=options.trust
        )
    except ValueError as error:
        raise UsageError(f"--policy: {error}") from error
    with closing(controller), closing(LiveView(controller, options.port)) as view:
        print(f"open {view.server.url} (Ctrl-C ends it)", flush=True)
        if options.browser and has_display():
            threading.Thread(target=webbrowser.open, args=(view.server.url,), daemon=True).start()
        try:
            view.run()
        except KeyboardInterrupt:
            raise KeyboardInterrupt("the view has ended") from None
    return 0
