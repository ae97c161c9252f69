"""Safety around any policy: `Safe(policies.make("trot"))`, or `policies.make("safe:trot")`."""

from policies.safety.limits import SafetyLimits
from policies.safety.safe import Event, Mode, Safe
from policies.safety.watch import DeadlineMissed, PolicyProcessError, Watched

__all__ = ["DeadlineMissed", "Event", "Mode", "PolicyProcessError", "Safe", "SafetyLimits", "Watched"]
