"""Find what is wrong with the installation, a robot or a policy: each check is printed as it ends, then a summary."""

from pathlib import Path

from quad_env.cli.command_line import UsageError, make_folder_of
from quad_env.doctor.check import DoctorCheck
from quad_env.doctor.command import DoctorOptions, run
from quad_env.files.paths import missing_file

__all__ = ["CHECKS", "DESCRIPTION_CHECKS", "DoctorOptions", "main"]

CHECKS = (
    DoctorCheck("walks", "live.walking_checks:walks", ("stands",)),
    DoctorCheck("policy", "live.walking_checks:policy", ("walks", "walking")),
)
"""They follow those of `quad_env.doctor`; the second is for runs with a policy."""
DESCRIPTION_CHECKS = (
    DoctorCheck("description", "live.walking_checks:description", ("stands",)),
    DoctorCheck("standing", "live.walking_checks:standing", ("description",)),
    DoctorCheck("walking", "live.walking_checks:walking", ("standing",)),
)
"""Between them, for a policy from another project."""


def main(options: DoctorOptions) -> int:
    """Run all checks, of walking and of the policy too; the exit code. Raises UsageError and PolicyError."""
    if options.policy is None:
        if options.write is not None:
            raise UsageError("--write needs --policy with the file of another project's policy")
        return run(options, CHECKS[:1])
    check_exists(options.policy)
    file = Path(options.policy.removeprefix("safe:"))
    if options.write is not None:
        _write(file, options.trust, options.write)
    described = DESCRIPTION_CHECKS if file.is_file() and file.suffix != ".zip" else ()
    return run(options, (CHECKS[0], *described, CHECKS[1]))


def _write(policy: Path, trust: bool, file: Path) -> None:
    """Write the policy's description as TOML, its missing fields as comments. Raises UsageError, PolicyError."""
    from policies.external.readers import IncompleteSpecError, write_draft, write_toml
    from policies.external.reference import draft_without_spec, resolve_reference

    make_folder_of(file, "--write")
    try:
        found = resolve_reference(policy, trust).spec if policy.is_file() else None
        draft = draft_without_spec(policy) if found is None else None
    except IncompleteSpecError as incomplete:
        found = None
        draft = incomplete
    if found is not None:
        write_toml(found, file)
        return
    if draft is None:
        raise UsageError(f"--write: {policy} has no description: write one by hand, docs/deployment-files.md")
    write_draft(draft, file)
    print(f"{file}: complete {', '.join(draft.missing)}, and name it in place of {policy}")


def check_exists(name_or_path: str) -> None:
    """Raise UsageError for a policy that is neither a name nor a file or folder."""
    try:
        import policies
    except ImportError:  # the checks say more about it
        return
    name = name_or_path.removeprefix(policies.SAFE)
    file = Path(name.partition(".py:")[0] + ".py") if ".py:" in name else Path(name)
    if (remedy := policies.unsupported_file_remedy(name)) is not None:
        raise UsageError(remedy)
    if name not in policies.names() and not file.exists():
        raise UsageError(
            missing_file(name)
            or f"no policy {name_or_path!r}: name one of {', '.join(policies.names())}, a folder or a file"
        )
