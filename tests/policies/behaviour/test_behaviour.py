import itertools
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import policies
from policies.base import CONTROL_PERIOD
from policies.behaviour import REQUESTS, TRANSITIONS, Behaviour, BehaviourMachine, State
from policies.behaviour.transitions import GUARDS, TIME_LIMIT, conditions
from quad_env.robots.simple_quad import SIMPLE_QUAD
from tests.policies.readings import reading

RESTING = {State.STAND, State.WALK, State.RUN}


def seen(n=1, up=1.0, turning=0.0, speed=0.0, joints=0.0, command=(0.0, 0.0, 0.0)):
    """Return the observation, (n, k), of a robot that leans sideways; `up` is the cosine of its tilt."""
    motion = {"angular_velocity": turning, "linear_velocity": speed, "joint_position": joints, "command": command}
    return reading(n, projected_gravity=(0.0, np.sqrt(1.0 - up * up), -up), **motion)


WITH = {  # observations under which a guard holds, and control steps until it does
    "in home pose": (seen(), 12),
    "toppling": (seen(up=0.2, turning=9.0), 1),
    "landed": (seen(), 95),
    "settled": (seen(up=0.2), 12),
    "late": (seen(up=0.9, turning=9.0), 900),
    "": (seen(up=0.9, turning=9.0), 1),
}
WITHOUT = {  # observations under which the guard does not hold
    "in home pose": seen(joints=0.5),
    "toppling": seen(),
    "landed": seen(speed=1.0),
    "settled": seen(up=0.2, turning=9.0),
}


def machine_in(state, n=1):
    machine = BehaviourMachine(state)
    machine.reset(n)
    machine.take_changes()
    return machine


EVERY_WAY = [(row, source) for row in TRANSITIONS for source in row.sources]


def test_every_transition_happens_where_the_table_says():
    for row, source in EVERY_WAY:
        machine = machine_in(source)
        observation, steps = WITH[row.guard]
        if not row.request:
            for _ in range(steps):
                if machine.state[0] != source:
                    break
                machine.observe(observation)
        else:
            for _ in range(min(steps, 12)):
                holds = conditions(SIMPLE_QUAD, CONTROL_PERIOD, observation, machine._state, np.full(1, steps))
                machine._holds = np.stack([holds[guard] for guard in GUARDS], axis=1)
            machine.request(row.request)
        assert machine.state[0] == row.target


def test_no_transition_happens_while_its_guard_does_not_hold():
    for row, source in EVERY_WAY:
        if row.guard not in WITHOUT:
            continue
        machine = machine_in(source)
        for _ in range(20):
            machine.observe(WITHOUT[row.guard])
            assert machine.state[0] != row.target
            if machine.state[0] != source:
                break


def test_every_request_that_the_table_lacks_is_refused():
    for state, request in itertools.product(State, REQUESTS):
        if not any(state in row.sources for row in TRANSITIONS if row.request == request):
            machine = machine_in(state)
            assert machine.request(request).all()
            assert machine.state[0] == state
    with pytest.raises(ValueError, match="stand, walk, run, jump"):
        BehaviourMachine().request("gallop")


def test_batch_request_moves_those_that_may_and_gives_the_mask_of_those_that_refuse():
    machine = BehaviourMachine()
    machine.reset(3)
    machine.observe(seen(3))
    assert not machine.request("walk", np.array([True, False, False])).any()
    refused = machine.request("run", np.ones(3, bool))
    assert refused.tolist() == [False, True, True]
    assert machine.state.tolist() == [State.RUN, State.STAND, State.STAND]


def test_every_state_leads_to_every_other_and_none_but_those_of_rest_waits_for_a_person():
    ahead = {state: {row.target for row in TRANSITIONS if state in row.sources} for state in State}
    for state in State:
        reached, frontier = {state}, {state}
        while frontier:
            frontier = {target for each in frontier for target in ahead[each]} - reached
            reached |= frontier
        assert reached == set(State)
    for state in set(State) - RESTING:
        assert state in TIME_LIMIT
        assert any(state in row.sources and row.guard == "late" and not row.request for row in TRANSITIONS)


events = st.one_of(
    st.tuples(st.just("ask"), st.sampled_from(REQUESTS), st.integers(0, 15)),
    st.tuples(
        st.just("see"),
        st.sampled_from([seen(4), seen(4, up=-0.9), seen(4, up=0.1, turning=9.0), seen(4, joints=0.6, speed=1.0)]),
        st.integers(1, 40),
    ),
)


@settings(max_examples=20)
@given(st.lists(events, max_size=15), st.sampled_from(State))
def test_random_commands_never_break_the_machine(script, start):
    """The state is always exactly one of the table, every change is in the table, and no state lasts forever."""
    machine = BehaviourMachine(start)
    machine.reset(4)
    legal = {(source, row.target) for row in TRANSITIONS for source in row.sources}

    def as_the_table_says(before):
        assert all(a == b or (a, b) in legal for a, b in zip(before, machine.state, strict=True))

    for kind, what, number in script:
        before = machine.state
        if kind == "ask":
            mask = np.array([bool(number >> bit & 1) for bit in range(4)])
            refused = machine.request(what, mask)
            assert not (refused & ~mask).any()
            assert (machine.state[~mask | refused] == before[~mask | refused]).all()
            as_the_table_says(before)
        else:
            for _ in range(number):
                before = machine.state
                machine.observe(what)
                as_the_table_says(before)
        assert machine.state.shape == (4,)
        assert set(machine.state.tolist()) <= set(State)
    patience = sum(round(limit / 0.01) for limit in TIME_LIMIT.values())
    while not set(machine.state.tolist()) <= RESTING:
        machine.observe(seen(4))
        assert (patience := patience - 1) > 0


def test_the_page_of_the_behaviours_has_every_transition_and_no_other():
    page = (Path(policies.__file__).parents[1] / "docs" / "behaviour.md").read_text(encoding="utf-8")
    rows = [[cell.strip() for cell in line.split("|")[1:-1]] for line in page.splitlines() if line.startswith("|")]
    expected = []
    for row in TRANSITIONS:
        sources = ", ".join(source.name.lower() for source in row.sources)
        expected.append([sources, row.request, row.guard, row.target.name.lower()])
    assert rows[2:] == expected
    arrows = [line.split("-->")[1].split(":")[0].strip() for line in page.splitlines() if "-->" in line]
    assert set(arrows) == {row.target.name.lower() for row in TRANSITIONS}


def test_policy_that_follows_walks_runs_and_stands_by_the_command_and_goes_limp_when_it_topples():
    policy = policies.make("behaviour")
    policy.reset(2)
    for command, expected in (((0.0, 0, 0), State.STAND), ((0.4, 0, 0), State.WALK), ((1.2, 0, 0), State.RUN)):
        for _ in range(30):
            policy.act(seen(2, command=command))
        assert policy.state.tolist() == [expected] * 2
    joints = np.linspace(-0.3, 0.3, 12).astype(np.float32)
    lying, upright = (seen(1, up=up, joints=joints, command=(1.2, 0, 0)) for up in (0.2, 1.0))
    damped, running = policy.act(np.concatenate((lying, upright)))
    np.testing.assert_allclose(damped, np.clip(SIMPLE_QUAD.home_pose + joints, -2.5, 1.5), atol=1e-6)
    assert np.abs(running - damped).max() > 0.1
    assert policy.state.tolist() == [State.FALL, State.RUN]


def test_changing_behaviour_makes_no_target_jump():
    policy = Behaviour(follow=False)
    policy.reset(1)
    last, largest = None, 0.0
    for step in range(400):
        if step in (100, 200, 300):
            policy.request({100: "walk", 200: "stand", 300: "walk"}[step])
        action = policy.act(seen(command=(0.5, 0.0, 0.0)))
        largest = max(largest, 0.0 if last is None else float(np.abs(action - last).max()))
        last = action
    assert largest < 0.4  # 40 rad/s
