"""`python -m benchmarks.solvers`: the programs of `mpc_wbc`, recorded on search episodes, solved by DAQP and others.

Each solver gets one program after the other, set-up included, as a controller would; matrices are in its form already.
A warm one begins with the answer to the program before, of the control step before, where that has the same shape. The
reference is Clarabel's interior-point method at 1e-10; it counts where its own residuals are below 1e-8.
"""

import importlib
import importlib.util
import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import daqp
import numpy as np
from scipy import sparse

from benchmarks.support.bars import check
from benchmarks.support.command import Outcome, Output, command, table
from benchmarks.support.measure import Floats
from evaluate.rollouts import rollout
from policies.mpc.policy import MpcWbc
from policies.mpc.quadratic_program import EQUALITY, SOLVED, Programs, Solutions, residuals, solve
from quad_env.cli.command_line import UsageError, check_numbers
from quad_env.cli.launcher import launch
from quad_env.seeding import episode_seeds
from train.scenarios import practice

SCENARIOS = ("flat", "push=35", "rough=0.12", "slippery=0.1", "payload=20")
TOLERANCE = 1e-6
"""Asked of solvers that iterate towards the optimum."""
PROVEN = 1e-8
"""Residual of a reference."""
EVERY = 17
"""Calls between two that are kept: no divisor of a stride's."""


@dataclass(frozen=True)
class Options(Output):
    """How many programs."""

    episodes: int = 3
    """Of each scenario (count)."""
    steps: int = 1000
    """Control steps of each (count)."""


class Recorded(NamedTuple):
    """A program and the one before it, if that has the same shape."""

    kind: str
    program: Programs
    before: Programs | None


class Recorder:
    """Solves as the policy does, and keeps one program of each kind in `EVERY`."""

    def __init__(self) -> None:
        self.kept: list[Recorded] = []
        self._last: dict[str, Programs] = {}
        self._calls = {"MPC": 0, "WBC": 0}

    def __call__(self, programs: Programs) -> Solutions:
        """The answers of `solve`."""
        kind = "WBC" if programs.equalities else "MPC"
        last, self._last[kind] = self._last.get(kind), programs
        self._calls[kind] += 1
        if self._calls[kind] % EVERY == 0:
            same = last is not None and last.rows.shape == programs.rows.shape
            self.kept.append(Recorded(kind, programs, last if same else None))
        return solve(programs)


class Answer(NamedTuple):
    """Of a solver: value (k,), multipliers (m,), whether it is content, s."""

    value: Floats
    multipliers: Floats
    content: bool
    seconds: float


Guess = tuple[Floats, Floats] | None
"""Value and multipliers to begin with."""


def _timed(call: Callable[[], Any]) -> tuple[Any, float]:
    began = time.perf_counter()
    return call(), time.perf_counter() - began


def _daqp(p: Programs, guess: Guess) -> Answer:
    sense = np.zeros(p.lower.shape[1], np.intc)
    sense[: p.equalities] = EQUALITY
    parts = [np.ascontiguousarray(part[0]) for part in (p.hessian, p.gradient, p.rows, p.upper, p.lower)]
    more = {} if guess is None else {"dual_start": guess[1]}
    (value, _, flag, info), seconds = _timed(lambda: daqp.solve(*parts, sense, **more))
    return Answer(value, info["lam"], flag == SOLVED, seconds)


def _piqp(p: Programs, _: Guess) -> Answer:
    piqp: Any = importlib.import_module("piqp")
    h, g, a, low, up = (part[0] for part in p[:5])
    e = p.equalities

    def call() -> Any:
        solver = piqp.DenseSolver()
        solver.settings.eps_abs = solver.settings.eps_rel = TOLERANCE
        solver.setup(h, g, a[:e] if e else None, up[:e] if e else None, a[e:], low[e:], up[e:])
        return solver.solve(), solver.result

    (status, result), seconds = _timed(call)
    multipliers = np.concatenate((result.y, result.z_u - result.z_l))
    return Answer(result.x, multipliers, status == piqp.Status.PIQP_SOLVED, seconds)


def _proxsuite(p: Programs, guess: Guess) -> Answer:
    proxqp: Any = importlib.import_module("proxsuite").proxqp
    h, g, a, low, up = (part[0] for part in p[:5])
    e, low = p.equalities, np.maximum(p.lower[0], -1e20)

    def call() -> Any:
        solver = proxqp.dense.QP(len(g), e, len(a) - e)
        solver.settings.eps_abs, solver.settings.eps_rel = TOLERANCE, 0.0
        solver.init(h, g, a[:e] if e else None, up[:e] if e else None, a[e:], low[e:], up[e:])
        if guess is None:
            solver.solve()
        else:
            solver.settings.initial_guess = proxqp.InitialGuess.WARM_START
            solver.solve(guess[0], guess[1][:e], guess[1][e:])
        return solver.results

    found, seconds = _timed(call)
    content = found.info.status == proxqp.QPSolverOutput.PROXQP_SOLVED
    return Answer(found.x, np.concatenate((found.y, found.z)), content, seconds)


def _osqp(p: Programs, guess: Guess) -> Answer:
    osqp: Any = importlib.import_module("osqp")
    upper_half, rows = sparse.csc_matrix(np.triu(p.hessian[0])), sparse.csc_matrix(p.rows[0])

    def call() -> Any:
        solver = osqp.OSQP()
        accuracy = {"eps_abs": TOLERANCE, "eps_rel": TOLERANCE}
        solver.setup(upper_half, p.gradient[0], rows, p.lower[0], p.upper[0], verbose=False, **accuracy)
        if guess is not None:
            solver.warm_start(x=guess[0], y=guess[1])
        return solver.solve(raise_error=False)

    found, seconds = _timed(call)
    return Answer(found.x, found.y, found.info.status == "solved", seconds)


def _clarabel(p: Programs, _: Guess) -> Answer:
    clarabel: Any = importlib.import_module("clarabel")
    rows, low, up, e = p.rows[0], p.lower[0], p.upper[0], p.equalities
    free = np.arange(len(rows)) >= e
    above, below = np.flatnonzero(free & np.isfinite(up)), np.flatnonzero(free & np.isfinite(low))
    stacked = sparse.csc_matrix(np.concatenate((rows[:e], rows[above], -rows[below])))
    bounds = np.concatenate((up[:e], up[above], -low[below]))
    cones = [clarabel.ZeroConeT(e), clarabel.NonnegativeConeT(len(above) + len(below))]
    settings = clarabel.DefaultSettings()
    settings.verbose = False
    settings.tol_gap_abs = settings.tol_gap_rel = settings.tol_feas = 1e-10
    hessian = sparse.csc_matrix(np.triu(p.hessian[0]))
    found, seconds = _timed(
        lambda: clarabel.DefaultSolver(hessian, p.gradient[0], stacked, bounds, cones, settings).solve()
    )
    z, multipliers = np.array(found.z), np.zeros(len(rows))
    multipliers[:e] = z[:e]
    multipliers[above] += z[e : e + len(above)]
    multipliers[below] -= z[e + len(above) :]
    return Answer(np.array(found.x), multipliers, True, seconds)


SOLVERS: dict[str, tuple[str, Callable[[Programs, Guess], Answer], bool]] = {
    "DAQP, as used": ("daqp", _daqp, False),
    "DAQP, warm": ("daqp", _daqp, True),
    "PIQP": ("piqp", _piqp, False),
    "ProxQP": ("proxsuite", _proxsuite, False),
    "ProxQP, warm": ("proxsuite", _proxsuite, True),
    "OSQP": ("osqp", _osqp, False),
    "OSQP, warm": ("osqp", _osqp, True),
}
"""Package, call and whether it begins with the answer before."""


def measure(options: Options) -> Outcome:
    """A table for each kind of program."""
    if options.quick:
        options = replace(options, episodes=1, steps=40)
    check_numbers(options, {"steps": (EVERY, rollout.STEPS)})
    if not _there("clarabel"):
        raise UsageError("the reference is missing: pip install clarabel")
    recorder = Recorder()
    for scenario in SCENARIOS:
        for seed in episode_seeds("search", 11, options.episodes):
            rollout.roll_out(
                MpcWbc(solver=recorder), practice(scenario, "search"), np.array([seed]), steps=options.steps
            )
    missing = sorted({package for package, *_ in SOLVERS.values() if not _there(package)})
    notes = [f"Not installed, so not in the tables: {', '.join(missing)}."] if missing else []
    figures: dict[str, Any] = {}
    tables, worst = [], {"cost": 0.0, "violation": 0.0}
    for kind in ("MPC", "WBC"):
        chosen = [(each, _clarabel(each.program, None)) for each in recorder.kept if each.kind == kind]
        proven = [pair for pair in chosen if _residual(pair[0].program, pair[1]) <= PROVEN]
        notes.append(f"{kind}: {len(proven)} of {len(chosen)} programs have a reference whose residual is below 1e-8.")
        heads = ("median ms", "99th", "cost", "violation", "residual", "failed")
        rows = table(f"{kind}, {len(proven)} programs; worst of each", "", *heads)
        for name, (package, call, warm) in SOLVERS.items():
            if package in missing:
                continue
            figures[f"{kind}, {name}"] = found = _judged(proven, call, warm)
            rows.add_row(name, *(f"{found[head]:.3f}" for head in heads[:2]), *(f"{found[h]:.1e}" for h in heads[2:5]),
                         str(found["failed"]))  # fmt: skip
            if name == "DAQP, as used":
                worst = {each: max(worst[each], found[each]) for each in worst}
        tables.append(rows)
    checks = (check("mpc cost", worst["cost"]), check("mpc violation", worst["violation"]))
    return Outcome(figures, tuple(tables), checks, tuple(notes))


def _judged(
    proven: list[tuple[Recorded, Answer]], call: Callable[[Programs, Guess], Answer], warm: bool
) -> dict[str, Any]:
    """Times and the worst of what a solver misses; what it fails at counts in its times and its failures alone."""
    seconds, missed, failed = [], [(0.0, 0.0, 0.0)], 0
    for (_, program, before), reference in proven:
        guess = None
        if warm and before is not None:
            earlier = solve(before)
            guess = (earlier.value[0], earlier.multipliers[0])
        answer = call(program, guess)
        seconds.append(answer.seconds)
        if not (answer.content and np.isfinite(answer.value).all()):
            failed += 1
            continue
        reached, best = _cost(program, answer.value), _cost(program, reference.value)
        beyond = program.rows[0] @ answer.value
        violation = max((beyond - program.upper[0]).max(), (program.lower[0] - beyond).max(), 0.0)
        missed.append((abs(reached - best) / max(abs(best), 1e-9), violation, _residual(program, answer)))
    cost, violation, residual = np.max(missed, axis=0)
    median, slow = 1e3 * np.percentile(seconds, (50, 99)) if seconds else (np.nan, np.nan)
    return {"median ms": median, "99th": slow, "cost": cost, "violation": violation, "residual": residual} | {
        "failed": failed
    }


def _cost(program: Programs, value: Floats) -> float:
    return float(0.5 * value @ program.hessian[0] @ value + program.gradient[0] @ value)


def _residual(program: Programs, answer: Answer) -> float:
    return float(residuals(program, answer.value[None], answer.multipliers[None]).worst[0])


def _there(package: str) -> bool:
    return importlib.util.find_spec(package) is not None


main = command(Options, measure, "benchmarks.solvers", __doc__)

if __name__ == "__main__":
    raise SystemExit(launch(main))
