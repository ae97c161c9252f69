"""The checks that come after those of `quad_env.doctor`, in their order."""

from pathlib import Path

from quad_env.doctor.check import Check

HERE = "live.doctor"
CHECKS = (
    Check("walks", f"{HERE}.walking:walks", ("stands",)),
    Check("models", f"{HERE}.bundles:models", ("model",)),
    Check("viewer", f"{HERE}.viewing:viewer", ("opengl",)),
)
OF_A_POLICY = Check("policy", f"{HERE}.bundles:policy", ("walks",))
"""Where one is given."""


def checks(policy: str | None) -> tuple[Check, ...]:
    """Those of every run, and that of the policy if one is given, by name or path. Raises ValueError, one line, for one
    that is not there."""
    if policy is None:
        return CHECKS
    _find(policy)
    return (*CHECKS, OF_A_POLICY)


def _find(name_or_path: str) -> None:
    try:
        import policies
    except ImportError:  # of which the checks say more
        return
    name = name_or_path.removeprefix(policies.SAFE)
    file = Path(name.partition(".py:")[0] + ".py") if ".py:" in name else Path(name)
    if (remedy := policies.unsupported(name)) is not None:
        raise ValueError(remedy)
    if name not in policies.names() and not file.exists():
        raise ValueError(f"no policy {name_or_path!r}: name one of {', '.join(policies.names())}, a folder or a file")
