"""Patterns of other projects' files for joint names: regular expressions, matched in a bounded time.

Python's `re` takes exponential time for some expressions, such as `((a*)*)*`. This matcher follows all paths at once. A
part of a pattern maps a set of positions in the name, as the bits of an integer, to the set of its ends.
"""

import string
from collections.abc import Callable
from functools import lru_cache

Part = Callable[[str, int], int]
"""Maps a name and a set of positions, as bits, to the positions where the part may end."""
MAX_PATTERN = 200
"""Largest number of characters of a pattern; those of published files have 60 at most."""
MAX_NAME = 100
"""Largest number of characters of a joint's name."""
MAX_DEPTH = 20
"""Largest depth of nested groups."""
MAX_COUNT = 1000
"""Largest number in `{m,n}`."""
SYNTAX = ". [...] (...|...) (?:...) (?=...) (?!...) * + ? {m,n} ^ $ \\w \\d \\s"
_CLASSES: dict[str, Callable[[str], bool]] = {
    "w": lambda sign: sign.isalnum() or sign == "_",
    "d": str.isdecimal,
    "s": str.isspace,
}


class PatternError(ValueError):
    """Invalid or unsupported pattern; the message is one line."""


def matches(pattern: str, name: str) -> bool:
    """Return whether a pattern matches the whole name, as `re.fullmatch` does. Raises PatternError."""
    if len(name) > MAX_NAME:
        raise PatternError(f"a name has at most {MAX_NAME} characters, got {len(name)}")
    return bool(_compiled(pattern)(name, 1) >> len(name) & 1)


@lru_cache(maxsize=1024)
def _compiled(pattern: str) -> Part:
    if len(pattern) > MAX_PATTERN:
        raise PatternError(f"a pattern has at most {MAX_PATTERN} characters, got {len(pattern)}")
    return _Parser(pattern).parse()


class _Parser:
    """Recursive descent over the text of one pattern."""

    def __init__(self, pattern: str) -> None:
        self._text = pattern
        self._place = 0
        self._depth = 0

    def parse(self) -> Part:
        part = self._alternatives()
        if self._place < len(self._text):
            raise self._error("unbalanced `)`")
        return part

    def _error(self, fault: str) -> PatternError:
        return PatternError(f"{fault} at character {self._place + 1}; valid: {SYNTAX}")

    def _peek(self) -> str:
        return self._text[self._place : self._place + 1]

    def _take(self, text: str) -> bool:
        """Step over a text if it comes next."""
        found = self._text.startswith(text, self._place)
        self._place += len(text) if found else 0
        return found

    def _alternatives(self) -> Part:
        branches = [self._sequence()]
        while self._take("|"):
            branches.append(self._sequence())
        return branches[0] if len(branches) == 1 else _either(branches)

    def _sequence(self) -> Part:
        parts = []
        while self._peek() not in ("", "|", ")"):
            parts.append(self._repeated(self._atom()))
        return _in_turn(parts)

    def _atom(self) -> Part:
        sign = self._peek()
        self._place += 1
        if sign == "(":
            return self._group()
        if sign == "[":
            return _one(self._set())
        if sign == ".":
            return _one(lambda each: each != "\n")
        if sign == "^":
            return lambda name, starts: starts & 1
        if sign == "$":
            return lambda name, starts: starts & (1 << len(name))
        if sign == "\\":
            return _one(self._escape())
        if sign in "*+?{":
            self._place -= 1
            raise self._error(f"nothing to repeat before `{sign}`")
        return _one(lambda each: each == sign)

    def _group(self) -> Part:
        self._depth += 1
        if self._depth > MAX_DEPTH:
            raise self._error(f"more than {MAX_DEPTH} nested groups")
        wrap: Callable[[Part], Part] = lambda part: part  # noqa: E731
        if self._take("?"):
            if self._take("="):
                wrap = _ahead
            elif self._take("!"):
                wrap = _not_ahead
            elif not self._take(":"):
                raise self._error("an unknown group `(?`")
        part = self._alternatives()
        if not self._take(")"):
            raise self._error("a missing `)`")
        self._depth -= 1
        return wrap(part)

    def _escape(self) -> Callable[[str], bool]:
        sign = self._peek()
        self._place += 1
        if sign.lower() in _CLASSES and sign:
            known = _CLASSES[sign.lower()]
            return known if sign.islower() else lambda each: not known(each)
        if not sign or sign in string.ascii_letters + string.digits:
            raise self._error(f"an unknown escape `\\{sign}`")
        return lambda each: each == sign

    def _set(self) -> Callable[[str], bool]:
        negated = self._take("^")
        tests: list[Callable[[str], bool]] = []
        first = True
        while first or not self._take("]"):
            first = False
            low = self._peek()
            if not low:
                raise self._error("a missing `]`")
            self._place += 1
            if low == "\\":
                tests.append(self._escape())
            elif self._peek() == "-" and self._text[self._place + 1 : self._place + 2] not in ("", "]", "\\"):
                high = self._text[self._place + 1]
                self._place += 2
                if high < low:
                    raise self._error(f"a range from {low} to {high}")
                tests.append(lambda each, low=low, high=high: low <= each <= high)  # type: ignore[misc]
            else:
                tests.append(lambda each, low=low: each == low)  # type: ignore[misc]
        return lambda each: any(test(each) for test in tests) != negated

    def _repeated(self, part: Part) -> Part:
        counts = self._counts()
        if counts is None:
            return part
        self._take("?")  # lazy: the same whole names
        if self._peek() in ("*", "+", "?", "{") and self._peek():
            raise self._error("a repetition of a repetition")
        return _repeat(part, *counts)

    def _counts(self) -> tuple[int, int | None] | None:
        """Return the least and most repetitions; None without any, and None as the most without a limit."""
        for sign, counts in {"*": (0, None), "+": (1, None), "?": (0, 1)}.items():
            if self._take(sign):
                return counts
        if not self._take("{"):
            return None
        inner, closed, _ = self._text[self._place :].partition("}")
        least, comma, most = inner.partition(",")
        if not closed or not all(each.isascii() and (each.isdigit() or not each) for each in (least, most)):
            raise self._error("a `{` that is no repetition")
        if (not least and not most) or max(len(least), len(most)) > 4:
            raise self._error("a `{` that is no repetition")
        self._place += len(inner) + 1
        low = int(least or 0)
        high = low if not comma else int(most) if most else None
        if max(low, high or 0) > MAX_COUNT or (high is not None and high < low):
            raise self._error(f"repetitions must rise and be at most {MAX_COUNT}")
        return low, high


def _one(test: Callable[[str], bool]) -> Part:
    """Return a part that takes one character."""

    def ends(name: str, starts: int) -> int:
        found = 0
        for place, sign in enumerate(name):
            if starts >> place & 1 and test(sign):
                found |= 2 << place
        return found

    return ends


def _in_turn(parts: list[Part]) -> Part:
    def ends(name: str, starts: int) -> int:
        for part in parts:
            starts = part(name, starts) if starts else 0
        return starts

    return ends


def _either(branches: list[Part]) -> Part:
    def ends(name: str, starts: int) -> int:
        found = 0
        for branch in branches:
            found |= branch(name, starts)
        return found

    return ends


def _ahead(part: Part) -> Part:
    """Return the positions from which the part matches."""
    return lambda name, starts: sum(1 << place for place in _places(starts) if part(name, 1 << place))


def _not_ahead(part: Part) -> Part:
    return lambda name, starts: sum(1 << place for place in _places(starts) if not part(name, 1 << place))


def _places(positions: int) -> list[int]:
    return [place for place in range(positions.bit_length()) if positions >> place & 1]


def _repeat(part: Part, least: int, most: int | None) -> Part:
    """Repeat a part; positions no longer change after as many repetitions as the name has characters."""
    part = _cached(part)

    def ends(name: str, starts: int) -> int:
        settled = len(name) + 1
        now = starts
        for _ in range(min(least, settled)):
            now = part(name, now)
        found = now
        for _ in range(settled if most is None else min(most - least, settled)):
            now = part(name, now)
            if not now & ~found:
                break
            found |= now
        return found

    return ends


def _cached(part: Part) -> Part:
    """Cache a part by name and position: repetitions within repetitions stay polynomial."""
    known: dict[int, int] = {}
    last: list[str] = []

    def ends(name: str, starts: int) -> int:
        if last != [name]:
            last[:] = [name]
            known.clear()
        found = 0
        for place in _places(starts):
            if place not in known:
                known[place] = part(name, 1 << place)
            found |= known[place]
        return found

    return ends
