"""Safety layer around any policy: it limits joint targets, and takes over after failures and predicted falls.

Make a policy with this layer by `Safe(policies.make("trot"))` or by `policies.make("safe:trot")`.
"""

from policies.safety.layer import Mode, Safe
from policies.safety.target_limits import SafetyLimits

__all__ = ["Mode", "Safe", "SafetyLimits"]
