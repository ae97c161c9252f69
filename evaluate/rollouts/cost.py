"""Expected computing time of an episode, with which an evaluation is divided into equal parts.

Only ratios matter. The constants are the same on every machine, so that every machine makes the same parts.
"""

from collections.abc import Iterable, Sequence

from evaluate.cells import LabelledPolicy
from policies.base import Policy
from policies.mpc.model_based import ModelBased
from quad_env.scenarios.scenario import Scenario
from quad_env.scenarios.terrain import Flat, Slope, Stairs

PLANE_COST = 100
"""Time of a control step of one robot on a plane, µs; measured on one core, in a batch of 24 robots."""
STAIRS_COST = 130
"""Time of a control step of one robot on stairs, µs; measured like PLANE_COST."""
UNEVEN_COST = 230
"""Time of a control step of one robot on a height field, µs; the mean of `rough` and `gravel`, like PLANE_COST."""
HARDWARE_COST = 120
"""Additional time of a control step with motor and sensor models and an estimator, µs; measured like PLANE_COST."""
POLICY_COST = 10
"""Time of an action of a scripted or learned policy, µs; measured like PLANE_COST."""
MODEL_BASED_COST = 270
"""Time of an action of a model-based controller, µs; measured like PLANE_COST."""


def episode_costs(policies: Iterable[LabelledPolicy], scenarios: Sequence[Scenario]) -> dict[str, int]:
    """Return the expected time of one episode of all policies that run on a scenario, µs per control step.

    Args:
        policies: Policies of the evaluation.
        scenarios: Scenarios of the evaluation.

    Returns:
        Name of a scenario -> expected time. Scenarios without policies are left out.
    """
    costs = dict.fromkeys((scenario.name for scenario in scenarios), 0)
    for policy in policies:
        for scenario in filter(policy.runs_on, scenarios):
            costs[scenario.name] += _simulation_cost(scenario) + _policy_cost(policy.policy_for(scenario))
    return {name: cost for name, cost in costs.items() if cost}


def _simulation_cost(scenario: Scenario) -> int:
    """Return the expected time of a control step of one robot without its policy, µs."""
    cost = UNEVEN_COST
    if isinstance(scenario.terrain, Flat | Slope):
        cost = PLANE_COST
    elif isinstance(scenario.terrain, Stairs):
        cost = STAIRS_COST
    return cost + HARDWARE_COST * scenario.hardware


def _policy_cost(policy: Policy) -> int:
    """Return the expected time of an action of a policy for one robot, µs."""
    return MODEL_BASED_COST if isinstance(policy, ModelBased) else POLICY_COST
