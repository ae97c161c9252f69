"""Groups of tasks that are simulated together: several policies on several scenarios."""

from collections.abc import Hashable, Sequence

from evaluate.cells import Task
from policies.base import Policy
from policies.external import ExternalPolicy
from quad_env.physics.simulators import SIMULATOR_FEATURES

TaskGroup = tuple[int, ...]
"""Indices of tasks that are simulated together, in ascending order."""


def group_tasks(tasks: Sequence[Task], max_rows: int, num_small: int = 0) -> list[TaskGroup]:
    """Divide tasks into groups; the tasks of a group are simulated together.

    The tasks of a group have policies that need the same environment except for the servo gains. No policy runs twice
    on one scenario. All scenarios of a group have the hardware profile, or none has it. An external policy runs alone,
    because the other policies would wait for its process.

    Args:
        tasks: Tasks of a run.
        max_rows: Maximum number of episodes in a group of several tasks; it limits the memory.
        num_small: Number of groups, the first ones, that have only one scenario each, so that first results come early.

    Returns:
        Groups with all indices of the tasks, in the order of their first tasks.
    """
    groups: list[list[int]] = []
    open_groups: dict[Hashable, list[list[int]]] = {}
    for index, task in enumerate(tasks):
        key = _environment(task)
        candidates = [] if key is None else open_groups.setdefault(key, [])
        small_groups = [id(each) for each in groups[:num_small]]
        with_room = (
            each
            for each in candidates
            if _has_room(tasks, each, task, max_rows)
            and (id(each) not in small_groups or tasks[each[0]].scenario is task.scenario)
        )
        group = next(with_room, None)
        if group is None:
            group = []
            groups.append(group)
            candidates.append(group)
        group.append(index)
    return [tuple(group) for group in groups]


def _has_room(tasks: Sequence[Task], group: Sequence[int], task: Task, max_rows: int) -> bool:
    """Return True if the `task` can join a group: it has at most `max_rows` episodes, and each cell only once."""
    members = [tasks[index] for index in group]
    rows = sum(len(member.seeds) for member in (*members, task))
    return rows <= max_rows and all(_cell(member) != _cell(task) for member in members)


def _cell(task: Task) -> tuple[int, int]:
    """Return the identity of the policy object and of the scenario of a `task`."""
    return id(_policy(task)), id(task.scenario)


def _policy(task: Task) -> Policy:
    """Return the policy object that runs a `task`."""
    return task.policy.policy_for(task.scenario)


def _environment(task: Task) -> Hashable | None:
    """Return a key that is equal for tasks that can run together; None if the task runs alone."""
    policy = _policy(task)
    if is_external(policy):
        return None
    simulator = task.hardware.simulator
    # Drake gives all robots the servo gains of the model.
    gains = b"" if SIMULATOR_FEATURES[simulator].per_env_servo_gains else policy.robot.gains.tobytes()
    needs = (policy.control_period, policy.height_scan, policy.observations, gains)
    return task.scenario.hardware, task.steps, task.hardware, needs


def is_external(policy: Policy) -> bool:
    """Return True if a policy, or the policy inside its safety layer, runs in a process of its own."""
    inner = policy
    while isinstance(next_inner := getattr(inner, "policy", None), Policy):
        inner = next_inner
    return isinstance(inner, ExternalPolicy)
