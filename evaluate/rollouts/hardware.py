"""What the robots of a run are built of. It imports nothing, for the options are to be shown quickly."""

from dataclasses import asdict, dataclass
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from policies.base import Policy
    from quad_env.robots.robot import Robot


@dataclass(frozen=True)
class Hardware:
    """Names that the environment's keyword arguments of the same names know."""

    actuator: str = "ideal"
    sensors: str = "truth"
    estimator: str = "complementary"

    @property
    def robot(self) -> "Robot":
        """The robot that has them; there is one so far."""
        from quad_env.robots.simple_quad import SIMPLE_QUAD

        return SIMPLE_QUAD

    def as_json(self) -> dict[str, str]:
        """The names; the estimator only where it is not the usual one, as before there was another."""
        names = asdict(self)
        return names if self.estimator != IDEAL.estimator else {n: names[n] for n in names if n != "estimator"}

    def policy(self, name_or_path: str, trust: bool = False) -> "Policy":
        """A fresh policy for that robot, by name or path, see `policies.resolve`; PolicyError if there is none."""
        import policies

        return policies.resolve(
            name_or_path, robot=self.robot, actuator=self.actuator, sensors=self.sensors, trust=trust
        )


IDEAL = Hardware()


def words(hardware: Hardware) -> str:
    """` Motors: motor; sensors: typical.`, an unusual estimator named too; nothing of ideal ones."""
    if hardware == IDEAL:
        return ""
    estimator = "" if hardware.estimator == IDEAL.estimator else f"; estimator: {hardware.estimator}"
    return f" Motors: {hardware.actuator}; sensors: {hardware.sensors}{estimator}."


def check(hardware: Hardware) -> None:
    """ValueError, which lists the valid names, where one is unknown or an estimator has no sensors."""
    from quad_env.actuation.models import actuator
    from quad_env.sensing.estimators import check_estimator
    from quad_env.sensing.suite import sensor_suite

    actuator(hardware.actuator)
    check_estimator(hardware.estimator, sensor_suite(hardware.sensors))
