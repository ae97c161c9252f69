"""Safety layer around any policy: `Safe(policies.make("trot"))`, or `policies.make("safe:trot")`."""

from policies.safety.layer import Mode, Safe
from policies.safety.target_limits import SafetyLimits

__all__ = ["Mode", "Safe", "SafetyLimits"]
