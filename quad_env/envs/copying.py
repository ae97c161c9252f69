"""Copies and pickles of an environment: made again from the arguments it was made with, as Gymnasium's own are."""

from typing import Any, ClassVar, Self


class MadeAgain:
    """An environment whose copies and pickles are new ones, made with its arguments, that have yet to be reset.

    A `reset` without a seed gives a copy the episode that it would have given the original. The state of MuJoCo's
    simulation itself can be neither copied nor pickled.
    """

    _KEPT: ClassVar[tuple[str, ...]] = ("spec",)
    """Attributes that a copy takes over."""

    def __new__(cls, *args: Any, **kwargs: Any) -> Self:
        """An environment that remembers what it was made with."""
        env = super().__new__(cls)
        env._arguments = args, kwargs
        return env

    _arguments: tuple[tuple[Any, ...], dict[str, Any]]

    def __reduce__(self) -> tuple[Any, ...]:
        return _make, (type(self), *self._arguments), {name: getattr(self, name) for name in self._KEPT}


def _make(kind: type, args: tuple[Any, ...], kwargs: dict[str, Any]) -> Any:
    return kind(*args, **kwargs)
