"""Behaviours of a robot as a state machine, and the motions that perform the behaviours."""

from policies.behaviour.machine import BehaviourMachine
from policies.behaviour.policy import Behaviour
from policies.behaviour.transitions import REQUESTS, TRANSITIONS, State

__all__ = ["REQUESTS", "TRANSITIONS", "Behaviour", "BehaviourMachine", "State"]
