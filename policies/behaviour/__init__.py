"""Behaviours of the robot as explicit states with explicit transitions, and their motions."""

from policies.behaviour.machine import BehaviourMachine
from policies.behaviour.policy import Behaviour
from policies.behaviour.transitions import REQUESTS, TRANSITIONS, State

__all__ = ["REQUESTS", "TRANSITIONS", "Behaviour", "BehaviourMachine", "State"]
