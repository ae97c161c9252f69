"""Language of the code: counts of hard-to-read forms in every package, each with a limit that only falls.

A count below its limit fails as well: the commit that lowers a count lowers the limit.
"""

import ast
import io
import re
import tokenize
from collections import Counter, defaultdict
from collections.abc import Iterator
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
PACKAGES = ("quad_env", "policies", "evaluate", "train", "live", "research", "benchmarks")
WORDS = re.compile(
    r"\b(what|whose|who|such(?! as)|so many|alike|beside|by which|of which|that of|those of|the same of|is to be"
    r"|as near as may be|told|tells|likewise|anew|whoever|foretold|billed|felt|heard)\b",
    re.IGNORECASE,
)
"""Words that the prose of docstrings and comments does without."""
OPENINGS = {"What", "Of", "Which", "Who", "Whose", "How", "Whether", "Where", "That", "Those", "Such"}
"""First words that make no sentence of a docstring."""
MAX_LINES = 40
"""Maximum number of lines of a function, without its docstring."""
MAX_LOCALS = 12
"""Maximum number of names that a function assigns."""
LIMITS: dict[str, dict[str, int]] = {
    "quad_env": {"functions over 12 locals": 1, "packed assignments of two": 13, "words": 3},
    "policies": {"packed assignments of two": 4},
    "evaluate": {"packed assignments of two": 2},
    "train": {"packed assignments of two": 3},
    "live": {},
    "research": {"packed assignments of two": 1},
    "benchmarks": {"packed assignments of two": 1},
}
"""Package -> kind -> largest count; 0 if a kind is absent."""
SAME_NAME: dict[str, set[str]] = {}
"""Classes of one name in two modules, with their modules."""

Function = ast.FunctionDef | ast.AsyncFunctionDef


def sources(package: str) -> Iterator[tuple[str, str, ast.Module]]:
    """Yield path, text and syntax tree of every module of a package."""
    for path in sorted((ROOT / package).rglob("*.py")):
        text = path.read_text(encoding="utf-8")
        yield path.relative_to(ROOT).as_posix(), text, ast.parse(text)


def findings(path: str, text: str, tree: ast.Module) -> Iterator[tuple[str, str]]:
    """Yield kind and place of every form that is counted."""
    public = set(public_functions(tree))
    for node in ast.walk(tree):
        place = f"{path}:{getattr(node, 'lineno', 1)}"
        if isinstance(node, ast.Assign) and (count := packed_count(node)) > 1:
            yield "packed assignments of two" if count == 2 else "packed assignments of three or more", place
        if isinstance(node, Function):
            yield from ((kind, f"{place} {node.name}") for kind in function_findings(node, node in public))
        if isinstance(node, Function | ast.ClassDef | ast.Module) and opening(node) in OPENINGS:
            yield "docstring openings", place
        if isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant) and isinstance(node.value.value, str):
            yield from (("words", f"{place} {word}") for word in WORDS.findall(node.value.value))
    for token in tokenize.generate_tokens(io.StringIO(text).readline):
        if token.type == tokenize.COMMENT:
            yield from (("words", f"{path}:{token.start[0]} {word}") for word in WORDS.findall(token.string))


def public_functions(node: ast.Module | ast.ClassDef) -> Iterator[Function]:
    """Yield the public functions of a module and the public methods of its public classes."""
    for child in node.body:
        if isinstance(child, ast.ClassDef) and not child.name.startswith("_"):
            yield from public_functions(child)
        if isinstance(child, Function) and not child.name.startswith("_"):
            yield child


def opening(node: Function | ast.ClassDef | ast.Module) -> str:
    """Return the first word of a docstring; empty without one."""
    return next(iter((ast.get_docstring(node) or "").split()), "")


def packed_count(node: ast.Assign) -> int:
    """Return the number of values that an assignment packs; 0 if it packs none."""
    targets = [target for target in node.targets if isinstance(target, ast.Tuple)]
    return len(node.value.elts) if targets and isinstance(node.value, ast.Tuple) else 0


def function_findings(function: Function, is_public: bool) -> Iterator[str]:
    """Yield the kinds of hard-to-read forms of a function."""
    first = function.body[0]
    docstring = ast.get_docstring(function)
    lines = function.end_lineno - function.lineno + 1 - (first.end_lineno - first.lineno + 1 if docstring else 0)
    if lines > MAX_LINES:
        yield f"functions over {MAX_LINES} lines"
    if len(local_names(function)) > MAX_LOCALS:
        yield f"functions over {MAX_LOCALS} locals"
    arguments = argument_names(function)
    if is_public and len(arguments) >= 2 and not describes(docstring or "", arguments):
        yield "public functions without Args"


def local_names(node: ast.AST) -> set[str]:
    """Return the names that a function assigns, without those of nested functions and comprehensions."""
    nested = (ast.FunctionDef, ast.AsyncFunctionDef, ast.Lambda, ast.ClassDef)
    comprehensions = (ast.ListComp, ast.SetComp, ast.DictComp, ast.GeneratorExp)
    names: set[str] = set()
    for child in ast.iter_child_nodes(node):
        if isinstance(child, ast.Name) and isinstance(child.ctx, ast.Store):
            names.add(child.id)
        if not isinstance(child, nested + comprehensions):
            names |= local_names(child)
    return names


def argument_names(function: Function) -> list[str]:
    """Return the names of a function's arguments except `self` and `cls`."""
    arguments = function.args
    named = arguments.posonlyargs + arguments.args + arguments.kwonlyargs
    return [each.arg for each in named if each.arg not in ("self", "cls")]


def describes(docstring: str, arguments: list[str]) -> bool:
    """Return True if a docstring has a section `Args:`, or is one line that names every argument."""
    if "Args:" in docstring:
        return True
    return "\n" not in docstring.strip() and all(re.search(rf"\b{name}\b", docstring) for name in arguments)


@pytest.mark.parametrize("package", PACKAGES)
def test_every_count_is_its_limit(package: str) -> None:
    places: dict[str, list[str]] = defaultdict(list)
    for source in sources(package):
        for kind, place in findings(*source):
            places[kind].append(place)
    counts = {kind: len(found) for kind, found in places.items()}
    limits = LIMITS.get(package, {})
    above = {kind: places[kind] for kind in counts if counts[kind] > limits.get(kind, 0)}
    assert not above, "\n".join(f"{kind}: {place}" for kind, found in above.items() for place in found)
    assert counts == limits, "a count has fallen: lower its limit"


def test_no_two_modules_have_classes_of_one_name() -> None:
    modules: dict[str, set[str]] = defaultdict(set)
    for package in PACKAGES:
        for path, _, tree in sources(package):
            for node in ast.walk(tree):
                if isinstance(node, ast.ClassDef):
                    modules[node.name].add(path)
    assert {name: found for name, found in modules.items() if len(found) > 1} == SAME_NAME


PLANTED = '''
"""What is told."""

def scaled(first, second):
    """Of the two."""
    a, b, c = first, second, 0.0  # whose sum
    return a + b + c


def documented(first, second):
    """Return `first` plus `second`."""
    return first + second
'''


def test_each_kind_is_found() -> None:
    found = Counter(kind for kind, _ in findings("planted.py", PLANTED, ast.parse(PLANTED)))
    assert found == {
        "packed assignments of three or more": 1,
        "docstring openings": 2,
        "words": 3,
        "public functions without Args": 1,
    }
    long = "def f():\n" + "".join(f"    x{i} = {i}\n" for i in range(41))
    assert {kind for kind, _ in findings("long.py", long, ast.parse(long))} == {
        "functions over 40 lines",
        "functions over 12 locals",
    }
