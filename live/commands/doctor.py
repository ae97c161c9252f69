"""Find faults of the installation, a robot or a policy: each check is printed as it ends, then a summary."""

from pathlib import Path

from quad_env.cli.command_line import UsageError, make_folder_of
from quad_env.doctor.check import DoctorCheck
from quad_env.doctor.command import DoctorOptions, run
from quad_env.files.paths import missing_file_message

__all__ = ["CHECKS", "DESCRIPTION_CHECKS", "DoctorOptions", "main"]

CHECKS = (
    DoctorCheck("walks", "live.walking_checks:check_reference_policy", ("stands",)),
    DoctorCheck("policy", "live.walking_checks:check_policy", ("walks", "walking")),
)
"""Checks of the command `doctor` in which a policy controls the robot; they run after the checks of `quad_env.doctor`.

The first check tests if the robot walks with a reference policy. The second check tests a policy of the user, and runs
only if the user names one.
"""
DESCRIPTION_CHECKS = (
    DoctorCheck("description", "live.walking_checks:check_description", ("stands",)),
    DoctorCheck("standing", "live.walking_checks:check_standing", ("description",)),
    DoctorCheck("walking", "live.walking_checks:check_walking", ("standing",)),
)
"""Checks of a policy from another project: its description, standing, and walking.

These checks run after the check with a reference policy, and before the check that the policy loads, fits and walks.
"""


def main(options: DoctorOptions) -> int:
    """Run the command `doctor`: check the installation, the robot, and the policy if one is given.

    Args:
        options: Options of the command.

    Returns:
        The exit code of the process.

    Raises:
        UsageError: `--write` was given and `--policy` was not.
    """
    if options.policy is None:
        if options.write is not None:
            raise UsageError("--write needs --policy with the file of another project's policy")
        return run(options, CHECKS[:1])
    check_exists(options.policy)
    file = Path(options.policy.removeprefix("safe:"))
    if options.write is not None:
        _write(file, options.trust, options.write)
    description_checks = DESCRIPTION_CHECKS if file.is_file() and file.suffix != ".zip" else ()
    return run(options, (CHECKS[0], *description_checks, CHECKS[1]))


def _write(policy: Path, trust: bool, file: Path) -> None:
    """Write the description of a policy from another project to a TOML file.

    The description defines the observations and actions of the policy. Fields that the policy's own files do not define
    are written as comments, for the user to complete.

    Args:
        policy: File of the policy.
        trust: True if the policy may be loaded from a file that can contain hidden code.
        file: TOML file to write.

    Raises:
        UsageError: The policy has no description.
    """
    from policies.external.readers import IncompleteSpecError, write_draft, write_toml
    from policies.external.reference import draft_without_spec, resolve_reference

    make_folder_of(file, "--write")
    try:
        spec = resolve_reference(policy, trust).spec if policy.is_file() else None
        draft = draft_without_spec(policy) if spec is None else None
    except IncompleteSpecError as incomplete:
        spec = None
        draft = incomplete
    if spec is not None:
        write_toml(spec, file)
        return
    if draft is None:
        raise UsageError(f"--write: {policy} has no description: write one by hand, docs/deployment-files.md")
    write_draft(draft, file)
    print(f"{file}: complete {', '.join(draft.missing)}, and name it in place of {policy}")


def check_exists(name_or_path: str) -> None:
    """Check that a policy exists.

    Args:
        name_or_path: Name, file or folder of the policy.

    Raises:
        UsageError: No policy, file or folder has this name, or this kind of file is not supported.
    """
    try:
        import policies
    except ImportError:  # A later check reports the missing package in more detail.
        return
    name = name_or_path.removeprefix(policies.SAFE)
    file = Path(name.partition(".py:")[0] + ".py") if ".py:" in name else Path(name)
    if (remedy := policies.unsupported_file_remedy(name)) is not None:
        raise UsageError(remedy)
    if name not in (*policies.names(), *policies.TRAINED) and not file.exists():
        raise UsageError(
            missing_file_message(name)
            or f"no policy {name_or_path!r}: name one of {', '.join(policies.names())}, a folder or a file"
        )
