"""Matcher of regular expressions for joint names, with a bounded computing time.

Files of other people contain the expressions, and Python's `re` takes exponential time for some expressions, for
example `((a*)*)*`. This matcher follows all possible matches at the same time, as a nondeterministic finite automaton
does. Each part of a pattern is a function from a set of start positions in the name to the set of possible end
positions. A set of positions is an integer; bit i is set if the set contains position i.
"""

import string
from collections.abc import Callable, Iterable
from functools import lru_cache

Part = Callable[[str, int], int]
"""Part of a regular expression: function from a name and start positions to possible end positions.

A set of positions in the name is an integer; bit i is set if the set contains position i.
"""
CharacterTest = Callable[[str], bool]
"""Function that returns True for the characters that a part of a regular expression matches."""
MAX_PATTERN = 200
"""Maximum number of characters of a regular expression; published files have at most 60."""
MAX_NAME = 100
"""Maximum number of characters of a joint's name that is matched."""
MAX_DEPTH = 20
"""Maximum depth of nested groups in a regular expression."""
MAX_COUNT = 1000
"""Maximum value of the numbers m and n in a repetition `{m,n}` of a regular expression."""
SYNTAX = ". [...] (...|...) (?:...) (?=...) (?!...) * + ? {m,n} ^ $ \\w \\d \\s"
"""Supported syntax of regular expressions, for error texts."""
_CLASSES: dict[str, CharacterTest] = {
    "w": lambda character: character.isalnum() or character == "_",
    "d": str.isdecimal,
    "s": str.isspace,
}
"""Letter of an escape in a regular expression -> function that returns True for matched characters.

For example, the function of `d` returns True for decimal digits.
"""
_REPETITIONS: dict[str, tuple[int, int | None]] = {"*": (0, None), "+": (1, None), "?": (0, 1)}
"""Repetition sign in a pattern -> minimum and maximum number of repetitions; None: no maximum."""


class PatternError(ValueError):
    """Raised for a regular expression that is invalid, too long or not supported; the message is one line."""


def matches(pattern: str, name: str) -> bool:
    """Return True if a regular expression matches the whole of a joint's name, as `re.fullmatch` does.

    Args:
        pattern: Regular expression.
        name: Name of a joint.

    Returns:
        True if the expression matches.

    Raises:
        PatternError: The expression is invalid or not supported, or the name or the expression is too long.
    """
    if len(name) > MAX_NAME:
        raise PatternError(f"a name has at most {MAX_NAME} characters, got {len(name)}")
    return bool(_compile(pattern)(name, 1) >> len(name) & 1)


@lru_cache(maxsize=1024)
def _compile(pattern: str) -> Part:
    if len(pattern) > MAX_PATTERN:
        raise PatternError(f"a pattern has at most {MAX_PATTERN} characters, got {len(pattern)}")
    return _Parser(pattern).parse()


class _Parser:
    """Recursive descent parser that converts a regular expression to a function of the type `Part`."""

    def __init__(self, pattern: str) -> None:
        self._text = pattern
        self._position = 0
        self._depth = 0

    def parse(self) -> Part:
        """Parse the whole regular expression. Raises PatternError if the expression is invalid."""
        part = self._parse_alternatives()
        if self._position < len(self._text):
            raise self._error("unbalanced `)`")
        return part

    def _error(self, fault: str) -> PatternError:
        return PatternError(f"{fault} at character {self._position + 1}; valid: {SYNTAX}")

    def _peek(self) -> str:
        """Return the next character of the pattern and keep the position; empty at the end of the pattern."""
        return self._text[self._position : self._position + 1]

    def _take(self, text: str) -> bool:
        """Return True if the pattern continues with `text`; the position then moves behind this text."""
        is_next = self._text.startswith(text, self._position)
        self._position += len(text) if is_next else 0
        return is_next

    def _parse_alternatives(self) -> Part:
        branches = [self._parse_sequence()]
        while self._take("|"):
            branches.append(self._parse_sequence())
        return branches[0] if len(branches) == 1 else _any_of(branches)

    def _parse_sequence(self) -> Part:
        parts = []
        while self._peek() not in ("", "|", ")"):
            parts.append(self._parse_repetition(self._parse_atom()))
        return _in_sequence(parts)

    def _parse_atom(self) -> Part:
        """Parse the next group, set, anchor, escape or single character of the pattern.

        Raises PatternError if it is invalid.
        """
        character = self._peek()
        self._position += 1
        if character == "(":
            return self._parse_group()
        if character == "[":
            return _one_character(self._parse_set())
        if character == ".":
            return _one_character(lambda each: each != "\n")
        if character == "^":
            return lambda name, starts: starts & 1
        if character == "$":
            return lambda name, starts: starts & (1 << len(name))
        if character == "\\":
            return _one_character(self._parse_escape())
        if character in "*+?{":
            self._position -= 1
            raise self._error(f"nothing to repeat before `{character}`")
        return _one_character(lambda each: each == character)

    def _parse_group(self) -> Part:
        self._depth += 1
        if self._depth > MAX_DEPTH:
            raise self._error(f"more than {MAX_DEPTH} nested groups")
        wrap: Callable[[Part], Part] = lambda part: part  # noqa: E731
        if self._take("?"):
            if self._take("="):
                wrap = _lookahead
            elif self._take("!"):
                wrap = _negative_lookahead
            elif not self._take(":"):
                raise self._error("an unknown group `(?`")
        part = self._parse_alternatives()
        if not self._take(")"):
            raise self._error("a missing `)`")
        self._depth -= 1
        return wrap(part)

    def _parse_escape(self) -> CharacterTest:
        character = self._peek()
        self._position += 1
        if character.lower() in _CLASSES and character:
            test = _CLASSES[character.lower()]
            return test if character.islower() else lambda each: not test(each)
        if not character or character in string.ascii_letters + string.digits:
            raise self._error(f"an unknown escape `\\{character}`")
        return lambda each: each == character

    def _parse_set(self) -> CharacterTest:
        """Parse a character set `[...]` after its opening bracket. Raises PatternError if it is invalid."""
        is_negated = self._take("^")
        tests = [self._parse_set_member()]
        while not self._take("]"):
            tests.append(self._parse_set_member())
        return lambda each: any(test(each) for test in tests) != is_negated

    def _parse_set_member(self) -> CharacterTest:
        """Parse the next escape, range or single character in a character set `[...]`.

        Raises PatternError if it is invalid.
        """
        low = self._peek()
        if not low:
            raise self._error("a missing `]`")
        self._position += 1
        if low == "\\":
            return self._parse_escape()
        if self._peek() == "-" and self._text[self._position + 1 : self._position + 2] not in ("", "]", "\\"):
            high = self._text[self._position + 1]
            self._position += 2
            if high < low:
                raise self._error(f"a range from {low} to {high}")
            return lambda each: low <= each <= high
        return lambda each: each == low

    def _parse_repetition(self, part: Part) -> Part:
        counts = self._parse_counts()
        if counts is None:
            return part
        self._take("?")  # The `?` of a lazy repetition is ignored, because the matched whole names are the same.
        if self._peek() in ("*", "+", "?", "{") and self._peek():
            raise self._error("a repetition of a repetition")
        return _repeat(part, *counts)

    def _parse_counts(self) -> tuple[int, int | None] | None:
        """Parse a repetition such as `*` or `{m,n}`, and return its minimum and maximum number.

        Returns None if the pattern does not continue with a repetition. A maximum of None means no limit.
        """
        for sign, counts in _REPETITIONS.items():
            if self._take(sign):
                return counts
        if not self._take("{"):
            return None
        inner, closing, _ = self._text[self._position :].partition("}")
        low_text, comma, high_text = inner.partition(",")
        if not closing or not all(_is_count(text) for text in (low_text, high_text)):
            raise self._error("a `{` that is no repetition")
        if (not low_text and not high_text) or max(len(low_text), len(high_text)) > 4:
            raise self._error("a `{` that is no repetition")
        self._position += len(inner) + 1
        low = int(low_text or 0)
        high = low if not comma else int(high_text) if high_text else None
        if max(low, high or 0) > MAX_COUNT or (high is not None and high < low):
            raise self._error(f"repetitions must rise and be at most {MAX_COUNT}")
        return low, high


def _is_count(text: str) -> bool:
    """Return True if a text is empty or consists of the digits 0 to 9."""
    return text.isascii() and (text.isdigit() or not text)


def _one_character(test: CharacterTest) -> Part:
    """Return the part of a regular expression that matches one character for which `test` is True."""

    def find_ends(name: str, starts: int) -> int:
        ends = 0
        for position, character in enumerate(name):
            if starts >> position & 1 and test(character):
                ends |= 2 << position
        return ends

    return find_ends


def _in_sequence(parts: list[Part]) -> Part:
    """Return the part of a regular expression that matches all given parts, one after another."""

    def find_ends(name: str, starts: int) -> int:
        for part in parts:
            starts = part(name, starts) if starts else 0
        return starts

    return find_ends


def _any_of(branches: list[Part]) -> Part:
    """Return the part of a regular expression that matches any one of the given parts (`a|b|c`)."""

    def find_ends(name: str, starts: int) -> int:
        ends = 0
        for branch in branches:
            ends |= branch(name, starts)
        return ends

    return find_ends


def _lookahead(part: Part) -> Part:
    """Return the lookahead `(?=...)`: it matches the empty text at positions where `part` matches."""
    return lambda name, starts: _to_bits(at for at in _positions(starts) if part(name, 1 << at))


def _negative_lookahead(part: Part) -> Part:
    """Return the negative lookahead `(?!...)`: it matches the empty text where `part` does not match."""
    return lambda name, starts: _to_bits(at for at in _positions(starts) if not part(name, 1 << at))


def _positions(bits: int) -> list[int]:
    """Return the positions in a name that an integer represents: the indices of its set bits."""
    return [position for position in range(bits.bit_length()) if bits >> position & 1]


def _to_bits(positions: Iterable[int]) -> int:
    """Return the integer that represents different positions in a name: bit i is set for position i."""
    return sum(1 << position for position in positions)


def _repeat(part: Part, minimum: int, maximum: int | None) -> Part:
    """Return the part of a regular expression that matches `minimum` to `maximum` repetitions of `part`.

    A maximum of None means no limit. The number of computed repetitions is limited by the length of the name, because
    further repetitions add no end positions.
    """
    part = _cache_ends(part)

    def find_ends(name: str, starts: int) -> int:
        enough = len(name) + 1
        current = starts
        for _ in range(min(minimum, enough)):
            current = part(name, current)
        ends = current
        for _ in range(enough if maximum is None else min(maximum - minimum, enough)):
            current = part(name, current)
            if not current & ~ends:
                break
            ends |= current
        return ends

    return find_ends


def _cache_ends(part: Part) -> Part:
    """Return a part of a regular expression that matches like `part` and caches the end positions.

    The cache is for the last matched name. With the cache, the computing time of nested repetitions grows only as a
    polynomial of the length of the name.
    """
    known: dict[int, int] = {}
    last: list[str] = []

    def find_ends(name: str, starts: int) -> int:
        if last != [name]:
            last[:] = [name]
            known.clear()
        ends = 0
        for position in _positions(starts):
            if position not in known:
                known[position] = part(name, 1 << position)
            ends |= known[position]
        return ends

    return find_ends
