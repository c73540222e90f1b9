"""Rest detection: scenes that sleep need no further step."""

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial

from jaxtyping import Float
from torch import Tensor

from pcnclaws.mpm.settings import SimulationSettings
from pcnclaws.mpm.state import ParticleState, Scenes
from pcnclaws.tensors.tensor_types import Vectors

# A scene rests if all its particles have been slower than this [m/s] ...
SLOW = 1e-4
# ... for this time [s], looked at so often ...
WINDOW = 0.025
LOOKS_OF_WINDOW = 5
# ... and if what they would move in the rest of the run, by their speed and by its change, is at most this share of ...
SHARE = 0.4
# ... the promise, which is this share of a cell.
TOLERANCE = 1e-3
# Looks come this share of their distance too late, by turns: a vibration never shows them the same phase.
GOLDEN = 0.5 * (math.sqrt(5.0) - 1.0)


@dataclass
class _Window:
    """How a scene moves since it has been slow, or since it was twice as fast as now.

    first     the step at its first look
    velocity  of the scene's particles then [m/s], (3, particles)
    fastest   the speed of the fastest particle at any look [m/s]
    """

    first: int
    velocity: Vectors
    fastest: float


class RestWatch:
    """Looks now and then how fast the scenes are, and says which ones have come to rest.

    With V the fastest speed of a window, a the mean acceleration over it and R the time that remains, a scene rests if

        V R + a R^2 <= 0.4 dx / 1000.

    A vibration of any period P moves by less than dx/1000 then. Of one that is short beside the window, V is the speed
    at its middle: it moves by at most P V / pi. Of a longer one, V and a together bound the amplitude: a body at a
    turning point, or at the top of its flight, has no speed, but it has an acceleration. Of free flight and slow
    turning V and a say all. What begins to move later, such as a slope that fails, is not foreseen.
    """

    def __init__(self, settings: SimulationSettings, steps: int) -> None:
        self._time_step, self._steps = settings.time_step, steps
        self._most = SHARE * TOLERANCE * settings.grid_spacing
        self._spacing = max(math.ceil(WINDOW / LOOKS_OF_WINDOW / settings.time_step), 1)
        self._windows: dict[int, _Window] = {}

    @property
    def looks(self) -> list[int]:
        """The steps after which to look."""
        places = range(1, self._steps // self._spacing + 1)
        looks = [k * self._spacing + int(k * GOLDEN % 1.0 * self._spacing) for k in places]
        return [n for n in looks if n < self._steps]

    def resting(self, n: int, numbers: tuple[int, ...], state: ParticleState, scenes: Scenes) -> list[int]:
        """Those of the scenes that have come to rest at step n.

        numbers  what the scenes of the state are called
        """
        speeds = fastest(state, scenes).tolist()
        velocities = (partial(velocities_of, scene, state, scenes) for scene in range(len(numbers)))
        looked = zip(numbers, speeds, velocities, strict=True)
        return [number for number, speed, velocity in looked if self._rests(n, number, speed, velocity)]

    def _rests(self, n: int, number: int, speed: float, velocity: Callable[[], Vectors]) -> bool:
        """Whether the scene of that number rests, whose fastest particle and whose particles have these velocities."""
        if not speed < SLOW:
            self._windows.pop(number, None)
            return False
        window = self._windows.get(number)
        if window is None or speed < 0.5 * window.fastest:
            self._windows[number] = _Window(n, velocity(), speed)
            return False
        speeds_up, window.fastest = speed > window.fastest, max(speed, window.fastest)
        duration, remaining = (steps * self._time_step for steps in (n - window.first, self._steps - n))
        by_speed = window.fastest * remaining
        if speeds_up or duration < WINDOW or by_speed > self._most:
            return False
        acceleration = float((velocity() - window.velocity).norm(dim=0).max()) / duration
        return by_speed + acceleration * remaining**2 <= self._most


def fastest(state: ParticleState, scenes: Scenes) -> Float[Tensor, " scenes"]:
    """The speed of the fastest particle of each scene [m/s]."""
    speed = state.velocity.detach().norm(dim=0)
    return speed.new_zeros(scenes.scene_count).scatter_reduce(0, scenes.scene_index, speed, "amax")


def velocities_of(scene: int, state: ParticleState, scenes: Scenes) -> Vectors:
    """The velocities of the particles of one scene [m/s], (3, particles)."""
    return state.velocity.detach()[:, scenes.scene_index == scene]
