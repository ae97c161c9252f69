"""A scenario: everything that an episode of a robot is made of, apart from its seed."""

from dataclasses import dataclass, field

from quad_env.config import AnyPose, CommandRanges, StartNoise, check_kinds
from quad_env.scenarios.disturbances import Dropouts, Ground, Latency, Motors, Payload, Pushes, SensorNoise, SteadyForce
from quad_env.scenarios.terrain import Flat, Terrain


@dataclass(frozen=True)
class Scenario:
    """Terrain, disturbances, commands and start of an episode; None is a disturbance that does not happen."""

    name: str
    terrain: Terrain = field(default_factory=Flat)
    pushes: Pushes | None = None
    commands: CommandRanges = field(default_factory=CommandRanges)
    start: StartNoise | AnyPose = field(default_factory=StartNoise)
    severity: float = 0.0
    """Severity on the scenario's own axis, in the unit of `severity_unit`; 0 where it is of none."""
    severity_unit: str = ""
    axis: str = ""
    """Name of an axis of `quad_env.scenarios.axes`, where the scenario is a severity of one."""
    force: SteadyForce | None = None
    ground: Ground = field(default_factory=Ground)
    motors: Motors = field(default_factory=Motors)
    payload: Payload | None = None
    latency: Latency | None = None
    noise: SensorNoise | None = None
    dropouts: Dropouts | None = None

    def __post_init__(self) -> None:
        check_kinds(self)
