"""Which scenes have come to rest and need no further step."""

import math

import torch
from jaxtyping import Float
from torch import Tensor

from pcnclaws.mpm.settings import SimulationSettings
from pcnclaws.mpm.state import ParticleState, Scenes

# A scene rests if all its particles have been slower than this [m/s] ...
SLOW = 1e-4
# ... and so slow that in the rest of the run they would move less than half of this share of a cell ...
TOLERANCE = 1e-3
# ... at every look within this time [s], and no faster at the last of them than at one before ...
WINDOW = 0.025
LOOKS_OF_WINDOW = 5
# ... which is also so many times longer than gravity alone would need to slow them down and speed them up again.
LONGER_THAN_AN_APEX = 10.0


class RestWatch:
    """Looks now and then how fast the scenes are, and says which ones have come to rest.

    A body at the top of its flight or of a vibration is slow for a moment only: it is not at rest, since the window is
    longer than that. What has been still for the window is taken to stay still.
    """

    def __init__(self, settings: SimulationSettings, steps: int) -> None:
        self._time_step, self._steps = settings.time_step, steps
        self._tolerance = TOLERANCE * settings.grid_spacing
        self.spacing = max(math.ceil(WINDOW / LOOKS_OF_WINDOW / settings.time_step), 1)
        # speeds of each scene at its looks since it has been slow
        self._slow: dict[int, list[float]] = {}

    @property
    def looks(self) -> range:
        """The steps after which to look."""
        return range(self.spacing, self._steps, self.spacing)

    def resting(self, n: int, numbers: tuple[int, ...], state: ParticleState, scenes: Scenes) -> list[int]:
        """Those of the scenes that have come to rest at step n.

        numbers  what the scenes of the state are called
        """
        remaining = (self._steps - n) * self._time_step
        limit = min(SLOW, 0.5 * self._tolerance / remaining)
        looked = torch.stack((fastest(state, scenes), scenes.gravity.norm(dim=0))).tolist()
        found = []
        for number, speed, gravity in zip(numbers, *looked, strict=True):
            if not speed < limit:
                self._slow.pop(number, None)
                continue
            speeds = self._slow.setdefault(number, [])
            window = max(WINDOW, LONGER_THAN_AN_APEX * 2.0 * limit / gravity if gravity > 0.0 else 0.0)
            if len(speeds) * self.spacing * self._time_step >= window and speed <= max(speeds[-LOOKS_OF_WINDOW:]):
                found.append(number)
            speeds.append(speed)
        return found


def fastest(state: ParticleState, scenes: Scenes) -> Float[Tensor, " scenes"]:
    """The speed of the fastest particle of each scene [m/s]."""
    speed = state.velocity.detach().norm(dim=0)
    return speed.new_zeros(scenes.scene_count).scatter_reduce(0, scenes.scene_index, speed, "amax")
