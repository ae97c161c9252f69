"""Whether intervals and tests err as often as they say."""
