"""One loop steps robots under a policy, whatever a study, a film or a search wants to see of it."""

import ast
from pathlib import Path

LOOPS = (ast.For, ast.While, ast.ListComp, ast.SetComp, ast.DictComp, ast.GeneratorExp)
OTHERS = (
    "train/training_robots.py",  # the learner's own
    # the speed of stepping alone
    *(f"benchmarks/{name}.py" for name in ("vector_env", "policies", "physics", "support/bare")),
    "live/commands/ros.py",  # a session's, paced, on what ROS sends
)
"""Modules that may step robots in loops of their own."""


def stepping_loops(code: str) -> int:
    """Loops of a module that call something's `step`, or the rollout's `advance`; of nested ones the inner."""
    loops = [node for node in ast.walk(ast.parse(code)) if isinstance(node, LOOPS)]
    stepping = [loop for loop in loops if any(map(is_step, ast.walk(loop)))]
    return sum(not any(inner in stepping for inner in ast.walk(loop) if inner is not loop) for loop in stepping)


def is_step(node: ast.AST) -> bool:
    if not isinstance(node, ast.Call):
        return False
    function = node.func
    is_method = isinstance(function, ast.Attribute) and function.attr == "step"
    return is_method or (isinstance(function, ast.Name) and function.id == "advance")


def test_the_count_sees_loops() -> None:
    assert stepping_loops("for _ in range(3):\n    if True:\n        x = env.step(a)\nenv.step(a)") == 1
    assert stepping_loops("while True:\n    env.step(a)\n[env.step(a) for a in b]") == 2
    assert stepping_loops("for _ in b:\n    for _ in c:\n        env.step(a)\n    policy.act(o)") == 1


def test_exactly_one_loop_steps_a_batch_outside_the_environment_and_the_learner(repository: Path) -> None:
    others = {repository / name for name in OTHERS}
    packages = (repository / package for package in ("policies", "evaluate", "train", "live", "benchmarks"))
    code = {path: path.read_text(encoding="utf-8") for package in packages for path in package.rglob("*.py")}
    assert others <= set(code)
    judged = {str(path.relative_to(repository)): text for path, text in code.items() if path not in others}
    found = {name: stepping_loops(text) for name, text in judged.items() if ".step(" in text}
    assert {name: count for name, count in found.items() if count} == {"evaluate/rollouts/rollout.py": 1}
