"""Observation terms equal numbers computed by hand and the values of the simulation."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest

import policies
from evaluate.rollouts.observers import Step
from evaluate.rollouts.rollout import roll_out
from policies.base import Floats, PolicyError
from policies.external.observation_adapter import ObservationAdapter, required_height_scan
from policies.external.spec import HeightGrid, SpecTerm
from quad_env import OBSERVATION, SIMPLE_QUAD, HeightScan
from quad_env.sensing.height_scan import table_with
from tests.policies.external.small_networks import make_spec

HOME, PERIOD = SIMPLE_QUAD.home_pose, 0.01
NETWORK = Path("policy.onnx")


def make_adapter(*wanted: SpecTerm, **fields: Any) -> ObservationAdapter:
    return ObservationAdapter(make_spec(NETWORK, wanted, **fields), SIMPLE_QUAD, PERIOD)


def standing(size: int = 48, **readings: Any) -> Floats:
    """Return the observation of a standing robot with the given readings, (1, k)."""
    row = np.zeros((1, size))
    for name, value in ({"projected_gravity": (0.0, 0.0, -1.0)} | readings).items():
        row[0, OBSERVATION[name]] = value
    return row


def observe_rows(of: ObservationAdapter, *rows: Floats) -> Floats:
    """Return the policy's observation after the given control steps of one robot, (k,)."""
    for row in rows:
        of.update_state(row)
        shown = of.observe(row, np.array([0]))
    return shown[0].astype(np.float64)


def test_angles_speeds_and_torques_are_in_the_order_of_the_observed_joints() -> None:
    numbers = np.arange(12.0)
    row = standing(joint_position=0.01 * numbers, joint_velocity=0.1 * numbers, previous_action=0.02 * numbers)
    names = ("absolute_joint_position", "joint_velocity", "joint_torque", "constant")
    of = make_adapter(*map(SpecTerm, names[:3]), SpecTerm(names[3], scale=(2.0,), values=(1.0, -3.0)))
    angles, speeds, torques, constant = np.split(observe_rows(of, row), [12, 24, 36])
    order = [3, 4, 5, 0, 1, 2, 9, 10, 11, 6, 7, 8]
    np.testing.assert_allclose(angles, (HOME + 0.01 * numbers)[order], atol=1e-6)
    np.testing.assert_allclose(speeds, 0.1 * numbers[order], atol=1e-6)
    given = SIMPLE_QUAD.servo_stiffness * 0.01 * numbers - SIMPLE_QUAD.servo_damping * 0.1 * numbers
    np.testing.assert_allclose(torques, given[order], atol=1e-4)
    np.testing.assert_allclose(constant, (2.0, -6.0))


def test_torques_are_limited_to_what_the_servos_can_give() -> None:
    torques = observe_rows(make_adapter(SpecTerm("joint_torque")), standing(previous_action=np.full(12, -2.0)))
    np.testing.assert_allclose(torques, -SIMPLE_QUAD.rated_torque)


def test_the_heading_frame_is_that_of_the_simulation() -> None:
    of = make_adapter(SpecTerm("linear_velocity", frame="heading"))

    def compare(step: Step) -> None:
        shown = observe_rows(of, step.observation.astype(np.float64))
        np.testing.assert_allclose(shown[:2], step.infos["heading_velocity"][0, :2], atol=1e-3)

    roll_out(policies.make("trot"), "rough", np.array([0]), compare, steps=60)


def test_the_world_frame_is_the_heading_at_the_start_of_each_episode() -> None:
    of, up = make_adapter(SpecTerm("linear_velocity", frame="world")), np.array((0.2, -0.3, np.sqrt(0.87)))
    spinning = standing(projected_gravity=-up, linear_velocity=2.0 * up, angular_velocity=0.5 * up)
    ahead = standing(linear_velocity=(1.0, 0.0, 0.2), angular_velocity=(0.0, 0.0, 0.5))
    np.testing.assert_allclose(observe_rows(of, *[spinning] * 101), (0.0, 0.0, 2.0), atol=1e-6)
    np.testing.assert_allclose(observe_rows(of, ahead), (np.cos(0.505), np.sin(0.505), 0.2), atol=1e-6)
    of.reset_where(np.array([True]))
    np.testing.assert_allclose(observe_rows(of, ahead), (1.0, 0.0, 0.2), atol=1e-6)


def test_contacts_are_those_of_the_simulation_in_nine_steps_of_ten() -> None:
    of = ObservationAdapter(make_spec(NETWORK, (SpecTerm("foot_contact"),)), SIMPLE_QUAD, PERIOD)
    of.reset(2)
    agreed: list[Floats] = []

    def compare(step: Step) -> None:
        row = step.observation.astype(np.float64)
        of.update_state(row)
        shown = of.observe(row, np.arange(2))
        true = step.infos["foot_contact"] > 0
        agreed.append(shown == true[:, [2, 1, 3, 0]])  # legs in the order of `JOINTS`

    roll_out(policies.make("mpc_wbc"), "flat", np.array([0, 1]), compare, steps=140)
    assert np.mean(agreed[40:]) > 0.9


def test_a_clock_is_at_zero_at_the_first_step() -> None:
    # At 50 Hz the seventh step is 6 * 20 ms after the first one; a clock of 2 Hz is at 0.24 cycles then.
    shown = observe_rows(make_adapter(SpecTerm("gait_clock", clock=2.0)), *[standing(command=(0.5, 0.0, 0.0))] * 7)
    np.testing.assert_allclose(shown, (np.sin(0.48 * np.pi), np.cos(0.48 * np.pi)), atol=1e-6)


@pytest.mark.parametrize(("command", "is_shown"), [((0.06, 0.06, 0.06), True), ((0.05, 0.05, 0.05), False)])
def test_a_clock_that_is_zero_at_small_commands_goes_on_meanwhile(
    command: tuple[float, float, float], is_shown: bool
) -> None:
    of = make_adapter(SpecTerm("gait_clock", clock=2.0, zero_below=0.1))
    shown = observe_rows(of, *[standing(command=command)] * 7)
    np.testing.assert_allclose(shown, (np.sin(0.48 * np.pi), np.cos(0.48 * np.pi)) if is_shown else 0.0, atol=1e-6)
    after = observe_rows(of, standing(command=(0.5, 0.0, 0.0)))
    np.testing.assert_allclose(after, (np.sin(0.56 * np.pi), np.cos(0.56 * np.pi)), atol=1e-6)
    with pytest.raises(PolicyError, match="`zero_below` belongs to the term gait_clock"):
        SpecTerm("command", zero_below=0.1)


def test_a_term_has_its_past_values_and_averages_after_its_present_value() -> None:
    term = SpecTerm("command", (2.0, 1.0, 1.0), clip=(-1.0, 3.0), lags=(0.01, 0.03), averages=(0.1,))
    of = make_adapter(term, control_rate=50.0)
    rows = [standing(command=(forward, 0.0, -2.0)) for forward in (1.0, 2.0, 3.0, 4.0)]
    shown = observe_rows(of, *rows)
    average = 2.0
    for value in (4.0, 6.0, 6.0):
        average += -np.expm1(-0.1) * (value - average)
    expected = [6.0, 0.0, -1.0, 6.0, 0.0, -1.0, 2.0, 0.0, -1.0, average, 0.0, -1.0]
    np.testing.assert_allclose(shown, expected, rtol=1e-6)


def test_a_position_error_is_the_integral_since_the_last_command() -> None:
    of = make_adapter(SpecTerm("position_error", bound=0.03))
    slow = standing(command=(1.0, 0.0, 0.5), linear_velocity=(0.5, 0.1, 0.0), angular_velocity=(9.0, 9.0, 0.5))
    other = standing(command=(0.9, 0.0, 0.5))
    np.testing.assert_allclose(observe_rows(of, *[slow] * 3), [0.01, -0.002, 0.0], atol=1e-7)
    np.testing.assert_allclose(observe_rows(of, *[slow] * 9), [0.03, -0.011, 0.0], atol=1e-7)
    np.testing.assert_allclose(observe_rows(of, other), [0.0, 0.0, 0.0], atol=1e-7)


def test_a_clock_is_faster_while_the_velocity_error_is_large() -> None:
    of = make_adapter(SpecTerm("gait_clock", clock=2.0, clock_gain=1.0, clock_limit=0.5), control_rate=100.0)
    shown = observe_rows(of, standing(command=(3.0, 0.0, 0.0)), standing(command=(3.0, 0.0, 0.0)))
    increase = np.array([0.3 * 0.5, 0.3 * 0.5 + 0.7 * 0.3 * 0.5])
    phase = 2.0 * np.pi * PERIOD * (2.0 + increase.sum())
    np.testing.assert_allclose(shown, [np.sin(phase), np.cos(phase)], rtol=1e-6)


@pytest.mark.parametrize(
    ("settings", "words"),
    [
        ({"name": "command", "clock_gain": 1.0}, "`clock_gain` belongs to the term gait_clock, not to command"),
        ({"name": "command", "bound": 1.0}, "`bound` belongs to the term position_error, not to command"),
        ({"name": "position_error"}, "`bound` belongs to the term position_error, not to position_error"),
        ({"name": "command", "lags": (0.1,), "history": 2}, "`history` must be 1 with `lags` or `averages`, not 2"),
        ({"name": "command", "averages": (11.0,)}, "`averages` is beyond any robot's: got 11; valid: 0 to 10 s"),
    ],
    ids=lambda value: " ".join(value) if isinstance(value, dict) else None,
)
def test_wrong_settings_of_past_values_are_named(settings: dict[str, Any], words: str) -> None:
    with pytest.raises(PolicyError, match=words):
        SpecTerm(**settings)


def test_past_values_are_in_the_digest_of_a_policy_that_has_them_alone() -> None:
    old = make_spec(NETWORK, (SpecTerm("command"),)).digest_text
    assert not any(name in old for name in ("lags", "averages", "bound", "clock_gain"))
    new = [make_spec(NETWORK, (SpecTerm("command", lags=(age,)),)).digest_text for age in (0.1, 0.2)]
    assert len({old, *new}) == 3


def test_robots_that_act_at_different_steps_have_clocks_histories_and_actions_of_their_own() -> None:
    """The second robot acts twice, then all three act: the clocks are at 1, 3 and 1 steps of 0.04 cycles."""
    of = make_adapter(SpecTerm("gait_clock", clock=2.0, history=2), SpecTerm("previous_action", history=2))
    of.reset(3)
    of.action[:] = np.array([1.0, 2.0, 3.0])[:, None]
    rows = np.repeat(standing(), 3, axis=0)
    for who in ([1], [1]):
        of.observe(rows[who], np.array(who))
    of.action[1] = 9.0
    all_three = np.arange(3)
    of.observe(rows, all_three)
    shown = of.observe(rows, all_three)
    now, before = np.sin(0.08 * np.pi * np.array([1, 3, 1])), np.sin(0.08 * np.pi * np.array([0, 2, 0]))
    np.testing.assert_allclose(shown[:, 0], before, atol=1e-6)
    np.testing.assert_allclose(shown[:, 2], now, atol=1e-6)
    np.testing.assert_allclose(shown[:, 4], [1.0, 9.0, 3.0])
    of.reset_where(np.array([False, True, False]))
    again = of.observe(rows[1:], all_three[1:])
    np.testing.assert_allclose(again[:, 2], np.sin(0.08 * np.pi * np.array([0, 2])), atol=1e-6)
    np.testing.assert_allclose(again[:, 4], [0.0, 3.0])


@pytest.mark.parametrize(
    ("newest", "expected"),
    [("last", [5.0, 6.0, 7.0, 0.7]), ("first", [7.0, 6.0, 5.0, 0.7])],
)
def test_terms_may_have_histories_of_different_lengths(newest: Any, expected: list[float]) -> None:
    """The observation has the last three forward commands and only the present angular velocity."""
    of = make_adapter(SpecTerm("command", history=3), SpecTerm("angular_velocity"), history_newest=newest)
    rows = [standing(command=(step, 0.0, 0.0), angular_velocity=(0.1 * step, 0.0, 0.0)) for step in range(8)]
    np.testing.assert_allclose(observe_rows(of, *rows)[::3], expected, atol=1e-6)


@pytest.mark.parametrize("side", [1.0, -1.0])
def test_a_scan_reaches_as_far_as_its_points_whichever_side_they_are_on(side: float) -> None:
    """The points of the grid are 0.1 and 0.2 m to a side, ahead and behind."""
    of = make_adapter(SpecTerm("height_scan", grid=HeightGrid((-0.1, 0.3), (0.1 * side, 0.2 * side))))
    scan = of.height_scan
    assert scan is not None
    assert (scan.ahead, scan.behind, scan.aside) == (3, 1, 2)
    assert scan.spacing == pytest.approx(0.1)
    row = standing(48 + len(scan.points))
    row[0, 48:] = 10.0 * scan.points[:, 0] + scan.points[:, 1]
    expected = [-(10.0 * x + y) for y in (0.1 * side, 0.2 * side) for x in (-0.1, 0.3)]
    np.testing.assert_allclose(observe_rows(of, row), expected, atol=1e-6)


@pytest.mark.parametrize("x_first", [True, False])
def test_points_of_a_height_scan_are_found_in_the_environments(x_first: bool) -> None:
    grid = HeightGrid((-0.2, 0.0, 0.4), (-0.1, 0.1), x_first, offset=0.5)
    term = SpecTerm("height_scan", grid=grid)
    scan = required_height_scan(make_spec(NETWORK, (term,)))
    assert scan == HeightScan(ahead=4, behind=2, aside=1, spacing=0.1)
    x, y = scan.points.T
    row = standing(table_with(SIMPLE_QUAD, scan).size)
    row[0, 48:] = -(0.3 + x + 10.0 * y)
    xs, ys = (np.tile(grid.x, 2), np.repeat(grid.y, 3)) if x_first else (np.repeat(grid.x, 2), np.tile(grid.y, 3))
    np.testing.assert_allclose(observe_rows(make_adapter(term), row), 0.3 + xs + 10.0 * ys - 0.5, atol=1e-6)


@pytest.mark.parametrize("x", [(0.0, 0.1, 0.2503), tuple(np.arange(-2000, 2001) / 1000)], ids=["irregular", "too many"])
def test_a_grid_that_the_environment_cannot_have_is_refused(x: tuple[float, ...]) -> None:
    with pytest.raises(PolicyError, match=r"policy\.onnx: height_scan is not available"):
        required_height_scan(
            make_spec(
                NETWORK,
                (
                    SpecTerm(
                        "height_scan",
                        grid=HeightGrid(x, (0.0, 0.7)),
                    ),
                ),
            )
        )
