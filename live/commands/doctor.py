"""Find what is wrong with the installation, a robot or a policy: each check is printed as it ends, then a summary."""

from pathlib import Path

from quad_env.cli.command_line import UsageError
from quad_env.doctor.check import Check
from quad_env.doctor.command import Options, run

__all__ = ["CHECKS", "Options", "main"]

CHECKS = (
    Check("walks", "live.walking:walks", ("stands",)),
    Check("description", "live.described:description", ("stands",)),
    Check("standing", "live.described:standing", ("description",)),
    Check("walking", "live.described:walking", ("standing",)),
    Check("policy", "live.walking:policy", ("walks", "walking")),
)
"""They follow those of `quad_env.doctor`: of the robot, of what describes a policy from another project, and of any
policy."""


def main(options: Options) -> int:
    """Run all checks, of walking and of the policy too; the exit code. Raises UsageError."""
    if options.policy is not None:
        check_exists(options.policy)
    if options.write is not None:
        _write(options, options.write)
    return run(options, _checks_of(options.policy))


def _checks_of(policy: str | None) -> tuple[Check, ...]:
    if policy is None:
        return CHECKS[:1]
    return CHECKS if _is_described(policy) else (CHECKS[0], CHECKS[-1])


def _is_described(policy: str) -> bool:
    """Whether it is a file that may have a description."""
    from policies.foreign.reference import DESCRIBED

    return Path(policy).suffix.lower() in DESCRIBED and not Path(policy).is_dir()


def _write(options: Options, file: Path) -> None:
    """Write the description of the policy. Raises UsageError where there is none, or for what cannot be written."""
    from policies import SAFE
    from policies.foreign.readers import write_toml
    from policies.foreign.reference import checked

    if options.policy is None or not _is_described(options.policy):
        raise UsageError("--write needs --policy with the file of another project's policy")
    if file.suffix != ".toml":
        raise UsageError(f"--write: {file} must end in .toml")
    if (found := checked(options.policy.removeprefix(SAFE), options.trust).description) is None:
        raise UsageError(f"--write: {options.policy} has no description: write one by hand, docs/deployment-files.md")
    try:
        write_toml(found, file)
    except OSError as error:
        raise UsageError(f"cannot write {file} ({error.strerror})") from error


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
