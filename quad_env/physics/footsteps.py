"""Tracker of the ground contact and motion of each foot of n robots, for rewards and observations."""

from collections.abc import Sequence

import numpy as np

from quad_env.columns import Array, EnvSelection, Mask
from quad_env.scenarios.terrain import Flat, Terrain

LEVEL_GROUND = Flat()
"""Level ground at the height 0, the default terrain of `FootContactTracker`."""
MAX_BOUNCE_STEPS = 1
"""Largest number of consecutive control steps off the ground that counts as a bounce of a foot.

A bounce does not count as a swing phase, but a longer time off the ground does. The variable `contact_filt` in
legged_gym follows the same rule.
"""


class FootContactTracker:
    """Tracker of contact, clearance, speed, swing time and touchdown speed of the feet in each control step.

    Args:
        period: Control period, s.
        contacts: For each foot, the contact counts of its sensors, (n, 1) per sensor; the simulator updates them.
        site_positions: Positions of all sites of the model, world frame, (n, sites, 3), m.
        foot_sites: Indices of the feet among the sites.
        terrain: Terrain below the feet.
        foot_radius: Distance from a foot's site to its underside, m.
    """

    def __init__(
        self,
        period: float,
        contacts: Sequence[Sequence[Array]],
        site_positions: Array,
        foot_sites: Sequence[int],
        terrain: Terrain = LEVEL_GROUND,
        foot_radius: float = 0.0,
    ) -> None:
        self._period = period
        self._contacts = contacts
        self._site_positions = site_positions
        self._foot_sites = list(foot_sites)
        self._terrain = terrain
        self._foot_radius = foot_radius
        self._air_steps = np.zeros((len(contacts[0][0]), len(contacts)))
        """Number of control steps since each foot left the ground, (n, 4); 0 for a foot on the ground.

        Time is counted in control steps to avoid rounding errors.
        """
        self.swing_time = np.zeros_like(self._air_steps)
        """Duration of the swing phase of each foot that touched down in the last step, (n, 4), s; 0 for other feet."""
        self.touchdown_speed = np.zeros_like(self._air_steps)
        """Downward speed of each foot that touched down in the last step, (n, 4), m/s; 0 for other feet."""
        self.contact = np.zeros(self._air_steps.shape, bool)
        """True for each foot on the ground in the last physics step, (n, 4)."""
        self.clearance = np.zeros_like(self._air_steps)
        """Height of the underside of each foot above the terrain, (n, 4), m."""
        self.speed = np.zeros_like(self._air_steps)
        """Horizontal speed of each foot over the last control step, (n, 4), m/s."""
        self._position = np.zeros((*self._air_steps.shape, 3))
        """Position of each foot at the end of the last control step, world frame, (n, 4, 3), m."""
        self._descent_speed = np.zeros_like(self._air_steps)

    def reset(self, env_ids: EnvSelection) -> None:
        """Start an episode of the robots `env_ids`, with all feet on the ground."""
        for values in (self._air_steps, self.swing_time, self.touchdown_speed, self._descent_speed, self.speed):
            values[env_ids] = 0.0
        self.contact[env_ids] = True
        self._position[env_ids] = self._foot_positions(env_ids)
        self.clearance[env_ids] = self._clearances(self._position[env_ids])

    def update(self, env_ids: EnvSelection) -> None:
        """Update contact, clearance, speed and touchdowns after a control step of the robots `env_ids`."""
        contact = touching(self._contacts, env_ids)
        air_steps = self._air_steps[env_ids]
        has_landed = contact & (air_steps > MAX_BOUNCE_STEPS)
        self.swing_time[env_ids] = np.where(has_landed, self._period * air_steps, 0.0)
        self.touchdown_speed[env_ids] = np.where(has_landed, self._descent_speed[env_ids], 0.0)
        position = self._foot_positions(env_ids)
        displacement = position - self._position[env_ids]
        self._descent_speed[env_ids] = np.maximum(-displacement[..., 2], 0.0) / self._period
        self.speed[env_ids] = np.hypot(displacement[..., 0], displacement[..., 1]) / self._period
        self.contact[env_ids] = contact
        self.clearance[env_ids] = self._clearances(position)
        self._position[env_ids] = position
        self._air_steps[env_ids] = np.where(contact, 0.0, air_steps + 1.0)

    def _foot_positions(self, env_ids: EnvSelection) -> Array:
        """Return the positions of the feet of the robots `env_ids`, world frame, (k, 4, 3), m."""
        return self._site_positions[env_ids][:, self._foot_sites]

    def _clearances(self, position: Array) -> Array:
        """Return the height of each foot's underside above the terrain, (k, 4), m.

        `position` are the positions of the foot sites, world frame, (k, 4, 3), m.
        """
        ground = self._terrain.height(position[..., 0], position[..., 1])
        clearance: Array = position[..., 2] - ground - self._foot_radius
        return clearance


def touching(contacts: Sequence[Sequence[Array]], env_ids: EnvSelection) -> Mask:
    """Return True for each robot part, such as a foot, that touched the ground in the last physics step.

    Args:
        contacts: For each part, the contact counts of its sensors, (n, 1) per sensor.
        env_ids: Indices of k robots, or a slice.

    Returns:
        True for each part that touched the ground, (k, parts).
    """
    counts = [sum((count[env_ids] for count in others), first[env_ids]) for first, *others in contacts]
    return np.concatenate(counts, axis=1) > 0
