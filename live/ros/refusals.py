"""Messages that are refused: counted, and each kind of mistake said once."""

from collections import Counter
from collections.abc import Callable

from quad_env.cli.format import counted


class Refusals:
    """Counts of refused messages by topic and mistake."""

    def __init__(self, say: Callable[[str], None]) -> None:
        self._say = say
        self._counts: Counter[tuple[str, str]] = Counter()

    def note(self, topic: str, mistake: str, details: str = "") -> None:
        """Count a message; the first of its kind is said, with the details, as the only one."""
        self._counts[topic, mistake] += 1
        if self._counts[topic, mistake] == 1:
            self._say(f"{topic}: refused, {mistake}{details}; further ones are counted")

    def count(self, topic: str) -> int:
        """Messages of that topic that were refused."""
        return sum(count for (name, _), count in self._counts.items() if name == topic)

    def words(self) -> list[str]:
        """`/cmd_vel: 12 messages refused, not finite` for each kind."""
        return [
            f"{topic}: {counted(count, 'message')} refused, {mistake}"
            for (topic, mistake), count in self._counts.items()
        ]
