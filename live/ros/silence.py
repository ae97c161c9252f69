"""A watchdog: whether messages have stopped coming, in simulated time."""


class Silence:
    """Begins when nothing has been heard for longer than a patience, s; before the first message there is none."""

    def __init__(self, patience: float) -> None:
        self.patience = patience
        self._latest: float | None = None

    def heard(self, now: float) -> bool:
        """Note a message at that time, s; whether it is the first, or the first after a silence."""
        anew, self._latest = self._latest is None, now
        return anew

    def begins(self, now: float) -> bool:
        """Whether a silence has begun by now that has not been told of."""
        # Rounded, for times are sums of control periods.
        if self._latest is None or round(now - self._latest, 6) <= self.patience:
            return False
        self._latest = None
        return True
