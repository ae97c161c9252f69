"""The steps of n robots' feet: how long each was in the air when it touches down, and how fast it came down."""

from collections.abc import Callable, Sequence

import numpy as np

from quad_env.columns import Array, Components, EnvSelection, Mask, ScalarOrBatch

MAX_BOUNCE_STEPS = 1
"""Control steps in a row off the ground that are no swing, as in legged_gym's `contact_filt`: landing feet bounce."""
Columns = Callable[[Array], Components[ScalarOrBatch]]
"""Takes the columns of the wanted robots out of the rows of all."""


class FootContactTracker:
    """Looks at the feet of n robots after every control step of `period` seconds.

    `contacts`: of each foot what its sensors found in the last substep, see `touching`; `places`: of all sites of the
    model in the world frame, (n, sites, 3), m, among them the feet's, `feet`.
    """

    def __init__(self, period: float, contacts: Sequence[Sequence[Array]], places: Array, feet: Sequence[int]) -> None:
        self._period, self._sensed, self._places, self._feet = period, contacts, places, list(feet)
        self._air_steps = np.zeros((len(contacts[0][0]), len(contacts)))
        """Control steps that each foot is off the ground; counted, so that no time is rounded more than once."""
        self.swing_time = np.zeros_like(self._air_steps)
        """See `QuadState`, (n, 4), s."""
        self.touchdown_speed = np.zeros_like(self._air_steps)
        """See `QuadState`, (n, 4), m/s."""
        self._height, self._descent_speed = np.zeros_like(self._air_steps), np.zeros_like(self._air_steps)

    def reset(self, ids: EnvSelection) -> None:
        """Begin the episode of those robots: no step of theirs is under way."""
        self._air_steps[ids] = self.swing_time[ids] = self.touchdown_speed[ids] = self._descent_speed[ids] = 0.0
        self._height[ids] = self._heights(ids)

    def advance(self, ids: EnvSelection) -> None:
        """Take note of the control step that those robots have just made."""
        contact, air = touching(self._sensed, ids), self._air_steps[ids]
        landed = contact & (air > MAX_BOUNCE_STEPS)
        self.swing_time[ids] = np.where(landed, self._period * air, 0.0)
        self.touchdown_speed[ids] = np.where(landed, self._descent_speed[ids], 0.0)
        height = self._heights(ids)
        self._descent_speed[ids] = np.maximum(self._height[ids] - height, 0.0) / self._period
        self._height[ids] = height
        self._air_steps[ids] = np.where(contact, 0.0, air + 1.0)

    def _heights(self, ids: EnvSelection) -> Array:
        return self._places[ids][:, self._feet, 2]


def touching(contacts: Sequence[Sequence[Array]], ids: EnvSelection) -> Mask:
    """Which parts of those robots touched the ground, (k, parts); `contacts` are what each part's sensors counted,
    (n, 1) each."""
    counts = [sum((found[ids] for found in others), first[ids]) for first, *others in contacts]
    return np.concatenate(counts, axis=1) > 0
