"""The chosen battery: the scenarios that every policy is judged on, unless the user names others."""

from quad_env.axes import AXES
from quad_env.scenarios import SCENARIOS, Scenario, scenario

DEFAULT = ("flat", "push", "rough")
ALL = "all"


def resolve(names: tuple[str, ...]) -> tuple[Scenario, ...]:
    """Scenarios of the given names; `all` is every one there is. ValueError lists the valid names."""
    if names == (ALL,):
        return tuple(SCENARIOS.values())
    if not names:
        raise ValueError(f"no scenario given; valid: {', '.join(SCENARIOS)}, {ALL}")
    if len(set(names)) < len(names):
        raise ValueError(f"a scenario is given twice: {' '.join(names)}")
    if ALL in names:
        raise ValueError(f"'{ALL}' stands alone, without other scenarios")
    return tuple(_one(name) for name in names)


def _one(name: str) -> Scenario:
    """`push`, or a level of an axis, `push:3`."""
    axis, colon, level = name.partition(":")
    if colon and axis in AXES and level.isdecimal():
        return AXES[axis].level(int(level))
    return scenario(name)
