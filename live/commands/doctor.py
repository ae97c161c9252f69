"""Find what is wrong with the installation, a robot or a policy: each check is printed as it ends, then a summary."""

from live.doctor.checks import checks
from quad_env.cli.command_line import UsageError
from quad_env.doctor.command import Options, run

__all__ = ["Options", "main"]


def main(options: Options) -> int:
    """Run all checks, of walking and policies too; the exit code. Raises UsageError."""
    try:
        of_policies = checks(options.policy)
    except ValueError as error:
        raise UsageError(str(error)) from error
    return run(options, of_policies)
