"""Safety layer of a policy: limits joint targets, takes over after failures and predicted falls.

Make a policy with this layer by `Safe(policies.make("trot"))` or by `policies.make("safe:trot")`.
"""

from policies.safety.layer import Mode, Safe
from policies.safety.target_limits import SafetyLimits

__all__ = ["Mode", "Safe", "SafetyLimits"]
