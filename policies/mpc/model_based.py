"""A gaited policy that knows its motion, the forces of its feet and its ground by the robot's model."""

import numpy as np
from numpy.typing import NDArray

from policies.base import GaitedPolicy, Mask
from policies.gait_cycle import TURN, Floats, Gait, LegCycle
from policies.memory import per_robot
from policies.mpc.contact import EARLIEST, LEAVING, ContactSense, ContactStates, contact_states
from policies.mpc.footing import Footprints
from policies.mpc.motion import Motion, Odometer, estimated_load, loaded
from policies.mpc.observer import JointPrediction, Observer
from policies.mpc.parameters import MpcParameters
from quad_env.actuation.models import Actuator
from quad_env.physics.dynamics import Dynamics

HURRY = 0.3
"""Of a change of frequency, what is made in a control period."""
FASTEST_JOINT = 2000.0
"""Joint acceleration, rad/s², that the inverted PD law counts on at most."""


class ModelBased(GaitedPolicy):
    """What controllers by the robot's model have in common: their senses, and a clock that can hurry."""

    stiff_servos = False  # targets carry their torques; soft servos yield at impacts
    _new: Mask = per_robot(True)
    _swinging: Mask = per_robot(np.zeros(4, np.bool_))
    _frequencies: Floats = per_robot(lambda policy: policy.frequency)

    def _equip(self, p: MpcParameters, late: int, actuator: Actuator, fastest_return: float = np.inf) -> None:
        """Make the gait and the senses, by those of the parameters that are theirs.

        `late`: control steps by which joints are older than the moment at which they are shown; `fastest_return`: see
        `Odometer`.
        """
        robot, period = self.robot, self.control_period
        self._senses, self._gait = p, Gait(self.leg_offsets, p.duty)
        self.sense = ContactSense(robot, p, period, actuator, encoders=late > 0)
        self._joints = JointPrediction(late, period)
        self.observer = Observer(robot, Dynamics(robot), period, actuator, late)
        self.prints = Footprints(p.slope_time, period)
        self.odometer = Odometer(p.farthest_behind, period, fastest_return)

    def _motion(self, observation: NDArray[np.float32]) -> tuple[Motion, Floats, Floats]:
        """Motion of the robots when their next targets take effect, with commands that make up for the way lost; the
        forces of their feet in the last control period, (n, 4, 3), N; and what pushes them besides their loads, (n, 6).

        `observation`: calibrated, see `ContactSense`.
        """
        p, sense = self._senses, self.sense
        load = estimated_load(sense.wrench, p.load_height)
        read = loaded(self.observer.read(observation, sense.wrench), load)
        if (unsure := self.observer.unsure).any():
            sense.reset_where(unsure)  # noise looks like pushes and loads
        away = (cycle := self._earlier()).swing & (cycle.progress > LEAVING) & (cycle.progress < EARLIEST)
        forces = sense.estimate(read, load.pressing(read.rotation), away)
        planned = self._joints.now(observation).astype(np.float64)
        now = loaded(self.observer.ahead(sense.wrench, sense.touching, self.prints.slope, planned), load)
        now = self.odometer.catching_up(now, p.position_gain)
        return now, forces, sense.wrench - load.pressing(now.rotation)

    def _contacts(self, forces: Floats) -> tuple[LegCycle, ContactStates]:
        """Where the legs are in their cycle, and which feet stand, by their forces, (n, 4, 3), N."""
        cycle, p, flies = self._gait.legs(self._phase), self._senses, self._gait.flies
        return cycle, contact_states(p, cycle, self._earlier(), forces[..., 2], self._new, flies=flies)

    def _earlier(self) -> LegCycle:
        """Where the legs were in their cycle when the readings were taken."""
        late = self.control_period * self.observer.delays
        return self._gait.legs(self._phase - TURN * self._frequencies * late)

    def _lifted(self, cycle: LegCycle) -> Mask:
        """Feet whose swing begins now, (n, 4)."""
        lifted, self._swinging = cycle.swing & ~self._swinging, cycle.swing
        return lifted

    @property
    def _height(self) -> float:
        """That the trunks are to have above the ground, m."""
        return self._senses.height - self.robot.hip_rise

    def _step_at(self, frequencies: Floats) -> None:
        """Advance the clocks, at frequencies that go to those wished for, (n,), Hz."""
        self._frequencies = self._frequencies + HURRY * (frequencies - self._frequencies)
        self._tick(self._frequencies - self.frequency)
