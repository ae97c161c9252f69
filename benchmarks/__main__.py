"""`python -m benchmarks`: the six measurements that together take a few minutes, with the limits of their figures.

The other commands, and more figures of these six: `python -m benchmarks.NAME --help`.
"""

from dataclasses import dataclass

from benchmarks import network, physics, policies, single_env, startup, vector_env
from benchmarks.support.bars import BARS
from benchmarks.support.command import BenchmarkResult, OutputOptions, make_command
from benchmarks.support.physics_settings import ORIGINAL_SETTINGS, SHIPPED
from quad_env.cli.launcher import launch


@dataclass(frozen=True)
class AllBenchmarksOptions(OutputOptions):
    """Options of the benchmarks that `python -m benchmarks` runs together."""


def measure(options: AllBenchmarksOptions) -> BenchmarkResult:
    """Run six benchmarks one after the other, with the options for which the requirements are defined.

    The benchmarks are `single_env`, `vector_env`, `physics`, `policies`, `network` and `startup`.

    Args:
        options: Options of the command.

    Returns:
        The measured values of all six benchmarks, with the checks of their requirements. The result also has
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
        "network": network.measure(network.NetworkBenchmarkOptions(quick=quick)),
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
