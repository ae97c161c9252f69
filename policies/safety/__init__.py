"""Safety around any policy: `Safe(policies.make("trot"))`, or `policies.make("safe:trot")`."""

from policies.safety.layer import Event, Mode, Safe
from policies.safety.target_limits import SafetyLimits
from policies.safety.watchdog import DeadlineMissed, PolicyProcessError, Watched

__all__ = ["DeadlineMissed", "Event", "Mode", "PolicyProcessError", "Safe", "SafetyLimits", "Watched"]
