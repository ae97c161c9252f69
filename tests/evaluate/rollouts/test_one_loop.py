"""One loop steps robots under a policy, whatever a study, a film or a search wants to see of it."""

import ast
from pathlib import Path

LOOPS = (ast.For, ast.While, ast.ListComp, ast.SetComp, ast.DictComp, ast.GeneratorExp)
TIMED = ("peers.py", "vector_env.py", "policies.py", "probes/growth_probe.py", "support/bare.py", "physics.py")
"""Benchmarks that measure the bare speed of stepping."""


def stepping_loops(code: str) -> int:
    """Loops of a module in which something's `step` is called; the innermost of nested ones counts."""
    loops = [node for node in ast.walk(ast.parse(code)) if isinstance(node, LOOPS)]
    stepping = [loop for loop in loops if any(map(is_step, ast.walk(loop)))]
    return sum(not any(inner in stepping for inner in ast.walk(loop) if inner is not loop) for loop in stepping)


def is_step(node: ast.AST) -> bool:
    return isinstance(node, ast.Call) and isinstance(node.func, ast.Attribute) and node.func.attr == "step"


def test_the_count_sees_loops() -> None:
    assert stepping_loops("for _ in range(3):\n    if True:\n        x = env.step(a)\nenv.step(a)") == 1
    assert stepping_loops("while True:\n    env.step(a)\n[env.step(a) for a in b]") == 2
    assert stepping_loops("for _ in b:\n    for _ in c:\n        env.step(a)\n    policy.act(o)") == 1


def test_exactly_one_loop_steps_a_batch_outside_the_environment_and_the_learner(repository: Path) -> None:
    timed = {repository / "benchmarks" / name for name in TIMED}
    modules = [
        path
        for package in ("policies", "evaluate", "train", "benchmarks")
        for path in (repository / package).rglob("*.py")
    ]
    assert timed <= set(modules)
    judged = [path for path in modules if path not in timed and "sb3" not in path.parts]
    code = {path: path.read_text() for path in judged}
    found = {str(path.relative_to(repository)): stepping_loops(text) for path, text in code.items() if ".step(" in text}
    assert {name: count for name, count in found.items() if count} == {"evaluate/rollouts/rollout.py": 1}
