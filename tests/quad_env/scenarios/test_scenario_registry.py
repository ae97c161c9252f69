"""Scenarios in text form: names, levels, severities, sums of scenarios, and invalid texts."""

from dataclasses import replace

import gymnasium as gym
import numpy as np
import pytest

import quad_env
from evaluate.analysis.severity_levels import axis_name
from evaluate.rollouts import battery
from quad_env import ENV_ID
from quad_env.scenarios.axes import AXES
from quad_env.scenarios.disturbances import Ground, Latency, Payload
from quad_env.scenarios.randomisation import DomainRandomisation
from quad_env.scenarios.registry import scenario
from quad_env.scenarios.scenario import Scenario
from quad_env.scenarios.terrain import Slope
from quad_env.serialisation import from_json_values, to_json_values


def test_a_combination_has_what_each_of_its_axes_sets() -> None:
    found = quad_env.scenario("payload=15+slope=10+latency=0.040")
    name = "payload=15+slope=10+latency=0.04"
    assert found == Scenario(name, terrain=Slope(np.radians(10)), payload=Payload(15.0), latency=Latency(0.04, 0.04))
    assert scenario(found.name) == found


def test_one_severity_is_a_scenario_of_its_axis() -> None:
    for axis in AXES.values():
        for severity in (axis.nominal, axis.levels[2]):
            written = f"{axis.name}={severity:g}"
            assert scenario(written) == axis.scenario(severity, written)


@pytest.mark.parametrize("name", ["push", "push:4", "push=42", "payload=15+slope=10", "steady"])
def test_the_hardware_profile_is_asked_for_at_the_end_of_a_name(name: str) -> None:
    found = scenario(f"{name}+hardware")
    assert found == replace(scenario(name), name=f"{name}+hardware", hardware=True)
    assert scenario(found.name) == found
    assert from_json_values(to_json_values(found)) == found


@pytest.mark.parametrize("name", ["push", "push:4", "push=42", "payload=15+slope=10", "steady", "push+hardware"])
def test_domain_randomisation_is_asked_for_at_the_end_of_a_name(name: str) -> None:
    found = scenario(f"{name}+randomised")
    plain, _, profile = name.partition("+hardware")
    profile = "+hardware" if name != plain else ""
    assert found == replace(scenario(name), name=f"{plain}+randomised{profile}", randomisation=DomainRandomisation())
    assert scenario(found.name) == found
    assert from_json_values(to_json_values(found)) == found
    assert battery.resolve_single(found.name) == found


def test_whole_batteries_are_randomised() -> None:
    quick = battery.resolve(("quick",))
    assert [each.name for each in battery.resolve(("all+randomised",))][:3] == [
        "flat+randomised",
        "push+randomised",
        "rough+randomised",
    ]
    assert len(battery.resolve(("quick+randomised+hardware",))) == len([each for each in quick if not each.hardware])


def test_levels_of_randomised_scenarios_are_an_axis_of_their_own() -> None:
    names = "push:3", "push:3+randomised", "push:3+hardware", "push:3+randomised+hardware"
    assert [axis_name(scenario(name)) for name in names] == [name.replace(":3", "") for name in names]


def test_a_scenario_of_before_there_was_a_profile_has_none() -> None:
    written = to_json_values(scenario("push:3"))
    del written["hardware"], written["randomisation"]
    assert from_json_values(written) == scenario("push:3")


def test_parts_of_one_thing_go_together() -> None:
    assert scenario("soft=0.02+slippery=0.4").ground == Ground(friction=0.4, sink_depth=0.02)
    assert scenario("flat=2+push=35").commands == AXES["flat"].at(2.0).commands
    alike = replace(AXES["surprise"].at(1.0), name="surprise=1+latency=0.01")
    assert scenario("surprise=1+latency=0.01") == alike, "what two axes set alike is no contradiction"


@pytest.mark.parametrize(
    ("name", "words"),
    [
        ("rough=0.1+gravel=0.1", "rough and gravel set the terrain differently; leave one out"),
        ("slippery=0.8+surprise=1", "slippery and surprise set the ground friction differently"),
        ("push=20+push=20", "push is given twice"),
        ("push=20+pull=3", "unknown axis 'pull'; valid: flat, push"),
        ("payload=15+hardware+slope=10", r"\+hardware stands at the end"),
        ("payload=15+randomised+slope=10", r"\+randomised stands at the end"),
        ("shove+hardware", "unknown scenario 'shove\\+hardware'; valid: flat, push"),
        ("push:99+hardware", "push has levels 1 to 8, not 99"),
        ("payload=15+slope", "slope needs a severity; write slope=15"),
        ("payload=heavy", "'heavy' is no number; write payload=5 for mass on the trunk"),
        ("push=-3", "impulse of each push is a number from 0 to"),
        ("slope=89", "slope=89: Slope.angle must be from 0 to 80°"),
        ("surprise=0", "surprise=0: the share must be more than 0"),
    ],
)
def test_what_cannot_be_combined_is_said_in_one_line(name: str, words: str) -> None:
    with pytest.raises(ValueError, match=words) as raised:
        scenario(name)
    assert "\n" not in str(raised.value)


def test_no_severity_beyond_the_sense_of_an_axis_ends_in_anything_but_a_value_error() -> None:
    for axis in AXES:
        for severity in ("-1", "0", "nan", "inf", "1e6", "1e-9", "2e6"):
            try:
                found = scenario(f"{axis}={severity}")
            except ValueError:
                continue
            assert np.isfinite(found.severity)


@pytest.mark.parametrize("written", ["push", "push:3", "push=42", "payload=15+slope=10"])
def test_an_environment_takes_every_scenario_that_commands_take(written: str) -> None:
    wanted = battery.resolve_single(written)
    with gym.make(ENV_ID, scenario=written) as env:
        assert env.unwrapped.scenario == wanted
    robots = gym.make_vec(ENV_ID, num_envs=2, scenario=written)
    assert robots.unwrapped.scenario == wanted
    robots.close()


@pytest.mark.parametrize(
    ("written", "words"),
    [
        ("flatt", "valid: flat, push, .*surprise, slow, steady, a level .* push:3, severities .* payload=15.slope=10"),
        ("pushh:3", "unknown scenario 'pushh:3'; valid: flat, push"),
        ("push:9", "push has levels 1 to 8, not 9"),
        ("push:hard", "valid: push:1 to push:8"),
        (3, "unknown scenario 3; valid: flat"),
    ],
)
def test_what_is_no_scenario_is_a_value_error_with_the_valid_names(written: str, words: str) -> None:
    with pytest.raises(ValueError, match=words):
        gym.make(ENV_ID, scenario=written)
