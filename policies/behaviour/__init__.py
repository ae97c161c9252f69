"""Behaviours of a robot: stand, walk, run, jump, fall and recover.

A state machine selects the behaviour of each robot. Sequences of joint targets, and a trot to walk and run, perform the
behaviour.
"""

from policies.behaviour.machine import BehaviourMachine
from policies.behaviour.policy import Behaviour
from policies.behaviour.transitions import REQUESTS, TRANSITIONS, State

__all__ = ["REQUESTS", "TRANSITIONS", "Behaviour", "BehaviourMachine", "State"]
