"""Default settings of a training for a robot: the policy observes quantities that the robot measures, at 50 Hz.

The simulated robots have the hardware profile (delays, noise and motors of the real robot) and domain randomisation.
"""

from collections.abc import Sequence
from typing import Literal

from policies.history import Inputs, TermName
from policies.input_terms import DEPLOYABLE_TERMS
from quad_env.cli.command_line import UsageError
from quad_env.scenarios.scenario import HARDWARE, RANDOMISED

Observations = Literal["all", "deployable", "estimated"]
"""Type of the option `--observations` of a training."""
OBSERVATION_TERMS: dict[Observations, tuple[TermName, ...]] = {
    "all": (),
    "deployable": DEPLOYABLE_TERMS,
    "estimated": (*DEPLOYABLE_TERMS, "linear_velocity"),
}
"""Value of `--observations` -> observation terms of the policy; without terms, the policy has the whole observation."""
HISTORY = 10
"""Number of last values of each term that the policy observes by default; 0.2 s at 50 Hz.

From several values the network can estimate the velocity of the trunk, and recognise delays and loads."""
HOLD = 2
"""Number of control steps of 10 ms for which the policy holds each action by default: 50 Hz, as on robots."""


def deployable_inputs(observations: Observations, clock: Inputs) -> Inputs:
    """Return the default network inputs of a training.

    Args:
        observations: Value of `--observations`, not all.
        clock: Inputs with the clock of the training; its frequency stays constant.

    Returns:
        The inputs.
    """
    terms = OBSERVATION_TERMS[observations]
    return Inputs(terms=terms, history=HISTORY, clock=clock.clock, clock_at_rest=clock.clock_at_rest)


def hardware_mixture(mixture: Sequence[tuple[str, float]]) -> tuple[tuple[str, float], ...]:
    """Return a mixture of scenarios on the hardware profile with domain randomisation.

    Args:
        mixture: Name and share of each scenario.

    Returns:
        Name and share of each scenario; scenarios that differed only in the suffixes are one.
    """
    shares: dict[str, float] = {}
    for name, share in mixture:
        changed = _plain_name(name) + RANDOMISED + HARDWARE
        shares[changed] = round(shares.get(changed, 0.0) + share, 9)
    return tuple(shares.items())


def hardware_scenarios(names: Sequence[str]) -> tuple[str, ...]:
    """Return the names of scenarios on the hardware profile, without domain randomisation and without repetitions."""
    return tuple(dict.fromkeys(_plain_name(name) + HARDWARE for name in names))


def _plain_name(name: str) -> str:
    """Return the name of a scenario without the suffixes of the hardware profile and of domain randomisation."""
    suffixes = (HARDWARE, RANDOMISED)
    while name.endswith(suffixes):
        name = name.removesuffix(HARDWARE).removesuffix(RANDOMISED)
    return name


def without_inputs(words: Sequence[str]) -> list[str]:
    """Return the words of a command line without the options of the group --inputs and their values.

    The defaults of these options depend on other options. So a command line is parsed first without them.
    """
    kept: list[str] = []
    is_input = False
    for word in words:
        if word.startswith("--"):
            is_input = word.startswith("--inputs.")
        if not is_input:
            kept.append(word)
    return kept


def observations_of(inputs: Inputs) -> Observations:
    """Return the value of `--observations` that has the terms of `inputs`; all if there is none."""
    for observations, terms in OBSERVATION_TERMS.items():
        if terms and set(inputs.terms) == set(terms):
            return observations
    return "all"


def check_observations(observations: Observations, inputs: Inputs) -> None:
    """Check that the network inputs of a training are those that its option --observations allows.

    Args:
        observations: Value of `--observations`.
        inputs: Network inputs of the training.

    Raises:
        UsageError: The inputs have a term that `--observations` excludes, or the whole observation.
    """
    valid = OBSERVATION_TERMS[observations]
    if not valid:
        return
    if not inputs.terms:
        remedy = "leave --observations out, or start with a policy of these inputs"
        raise UsageError(f"--observations: {observations} needs --inputs.terms, got the whole observation; {remedy}")
    if excluded := [name for name in inputs.terms if name not in valid]:
        fact = f"{observations} observations have no {', '.join(excluded)}"
        raise UsageError(f"--inputs.terms: {fact}; valid: {' '.join(valid)}")
