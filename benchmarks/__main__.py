"""`python -m benchmarks`: the five measurements that together take a few minutes, with the limits of their figures.

The other commands, and more figures of these five: `python -m benchmarks.NAME --help`.
"""

from dataclasses import dataclass

from benchmarks import physics, policies, single_env, startup, vector_env
from benchmarks.support.bars import BARS
from benchmarks.support.command import BenchmarkResult, OutputOptions, make_command
from benchmarks.support.physics_settings import ORIGINAL_SETTINGS, SHIPPED
from quad_env.cli.launcher import launch


@dataclass(frozen=True)
class AllBenchmarksOptions(OutputOptions):
    """Options of the benchmark of single environment, vector environment, physics, policies and start-up."""


def measure(options: AllBenchmarksOptions) -> BenchmarkResult:
    """Run five benchmarks one after the other, with the options for which the requirements are defined.

    The five benchmarks are `single_env`, `vector_env`, `physics`, `policies` and `startup`.

    Args:
        options: Options of the command.

    Returns:
        The measured values of all five benchmarks, with the checks of their requirements. The result also has
        the names of the requirements that only other benchmark commands check.
    """
    quick = options.quick
    scenario, envs = vector_env.REFERENCE
    results = {
        "single_env": single_env.measure(single_env.SingleEnvBenchmarkOptions(quick=quick)),
        "vector_env": vector_env.measure(
            vector_env.VectorEnvBenchmarkOptions(quick=quick, envs=(envs,), scenarios=(scenario,))
        ),
        "physics": physics.measure(physics.PhysicsBenchmarkOptions(quick=quick, settings=(SHIPPED, ORIGINAL_SETTINGS))),
        "policies": policies.measure(policies.PoliciesBenchmarkOptions(quick=quick)),
        "startup": startup.measure(startup.StartupBenchmarkOptions(quick=quick)),
    }
    return BenchmarkResult(
        figures={name: result.figures for name, result in results.items()},
        tables=(),
        checks=tuple(check for result in results.values() for check in result.checks),
        unmeasured=tuple(name for name, requirement in BARS.items() if requirement.command not in results),
    )


main = make_command(AllBenchmarksOptions, measure, "benchmarks", __doc__)

if __name__ == "__main__":
    raise SystemExit(launch(main))
