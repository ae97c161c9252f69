"""Change of a scenario's severity after the environment was made."""

from dataclasses import fields, is_dataclass, replace
from typing import Any

from quad_env.robots.robot import Robot
from quad_env.scenarios.axes import known_axes
from quad_env.scenarios.scenario import Scenario
from quad_env.scenarios.terrain import GradedRandom

OPTION = "options['severity']"
"""Name of the option of `reset`, for error messages."""
PER_EPISODE = frozenset(
    (
        "commands.forward",
        "commands.lateral",
        "commands.yaw_rate",
        "pushes.impulse",
        "force.force",
        "noise.gyro",
        "dropouts.duration",
    )
)
"""Settings of a scenario that every episode reads."""
PER_MODEL = frozenset(("ground.friction", "payload.mass"))
"""Settings of a scenario that become fields of a robot's own MuJoCo model."""
IN_ONE_FIELD = frozenset(("terrain.peak_to_valley",))
"""Settings that select the place of start on a height field of all severities."""
UP_TO_MADE = frozenset(("latency.action", "latency.observation"))
"""Settings that may be reduced; buffers have the length for the value of the scenario."""


def at_severity(scenario: Scenario, severity: float, robot: Robot, per_robot_models: bool = True) -> Scenario:
    """Return a scenario at another severity of its disturbance axis.

    Only the settings that the axis moves change. ValueError is raised if an environment of `scenario` cannot simulate
    the result.

    Args:
        scenario: Scenario of the environment.
        severity: New severity, in the unit of the axis.
        robot: Robot of the scenario.
        per_robot_models: True if the simulator can give every robot its own friction and masses.

    Returns:
        The scenario at the severity.

    Raises:
        ValueError: The scenario has no axis, the axis does not have the severity, or a setting cannot be moved.
    """
    axis = known_axes(robot).get(scenario.axis)
    if axis is None:
        raise ValueError(f"{OPTION}: {scenario.name} has no axis to move; valid: a scenario of one axis, such as push")
    try:
        before = axis.at(scenario.severity)
        moved: Scenario = _moved(scenario, before, axis.at(severity))
    except ValueError as error:
        raise ValueError(f"{OPTION}: {axis.name}={severity:g} does not exist ({error})") from None
    changed = _changed_settings(scenario, moved)
    movable = _movable_settings(scenario, per_robot_models)
    if fixed := [path for path in changed if path not in movable]:
        graded = ", or terrain.graded(max_peak_to_valley)" if IN_ONE_FIELD.issuperset(fixed) else ""
        raise ValueError(
            f"{OPTION}: {axis.name} cannot be moved, {' and '.join(fixed)} is fixed when the environment is made, "
            f"got {severity:g}; valid: gym.make_vec(..., scenario=[...]) with {axis.name} at each severity{graded}"
        )
    if severity > scenario.severity and any(path in UP_TO_MADE for path in changed):
        raise ValueError(
            f"{OPTION}: {axis.name} was made for {scenario.severity:g} {axis.unit}, got {severity:g}; "
            f"valid: up to {scenario.severity:g}, or make the environment with {axis.name}={severity:g}"
        )
    return replace(moved, severity=severity)


def _movable_settings(scenario: Scenario, per_robot_models: bool) -> frozenset[str]:
    """Return the settings that a reset may change; friction and payload only if `per_robot_models` is True."""
    movable = PER_EPISODE | UP_TO_MADE
    if per_robot_models:
        movable |= PER_MODEL
    if isinstance(scenario.terrain, GradedRandom):
        movable |= IN_ONE_FIELD
    return movable


def _moved(value: Any, before: Any, after: Any) -> Any:
    """Return `value` with the difference from `before` to `after`, in the fields of dataclasses that differ."""
    if before == after:
        return value
    if not is_dataclass(value) or not isinstance(value, type(before)) or type(before) is not type(after):
        return after
    differing = [field.name for field in fields(before) if getattr(before, field.name) != getattr(after, field.name)]
    return replace(
        value,  # type: ignore[type-var]
        **{name: _moved(getattr(value, name), getattr(before, name), getattr(after, name)) for name in differing},
    )


def _changed_settings(value: Any, moved: Any, path: str = "") -> list[str]:
    """Return the names of the settings that differ between two scenarios, such as `ground.friction`."""
    if value == moved:
        return []
    if not is_dataclass(value) or type(value) is not type(moved):
        return [path]
    changes = []
    for field in fields(value):
        name = f"{path}.{field.name}" if path else field.name
        changes += _changed_settings(getattr(value, field.name), getattr(moved, field.name), name)
    return changes
