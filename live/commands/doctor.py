"""Find what is wrong with the installation, a robot or a policy: each check is printed as it ends, then a summary."""

from pathlib import Path

from quad_env.cli.command_line import UsageError
from quad_env.doctor.check import Check
from quad_env.doctor.command import Options, run

__all__ = ["CHECKS", "Options", "main"]

CHECKS = (Check("walks", "live.walking:walks", ("stands",)), Check("policy", "live.walking:policy", ("walks",)))
"""They follow those of `quad_env.doctor`; the second is for runs with a policy."""


def main(options: Options) -> int:
    """Run all checks, of walking and of the policy too; the exit code. Raises UsageError."""
    if options.policy is not None:
        check_exists(options.policy)
    return run(options, CHECKS if options.policy is not None else CHECKS[:1])


def check_exists(name_or_path: str) -> None:
    """Raise UsageError for a policy that is neither a name nor a file or folder."""
    try:
        import policies
    except ImportError:  # the checks say more about it
        return
    name = name_or_path.removeprefix(policies.SAFE)
    file = Path(name.partition(".py:")[0] + ".py") if ".py:" in name else Path(name)
    if (remedy := policies.unsupported(name)) is not None:
        raise UsageError(remedy)
    if name not in policies.names() and not file.exists():
        raise UsageError(f"no policy {name_or_path!r}: name one of {', '.join(policies.names())}, a folder or a file")
