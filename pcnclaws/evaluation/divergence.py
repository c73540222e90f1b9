"""Scenes that diverge among others that do not: they are noted, and the others go on."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import TypeVar

from pcnclaws.errors import SimulationDiverged
from pcnclaws.simulation.records import SceneRecord
from pcnclaws.simulation.scenes import SceneStart

# Scenes that are simulated together at first.
SCENES_OF_BATCH = 12

Scene = TypeVar("Scene", SceneStart, SceneRecord)
Done = TypeVar("Done")


@dataclass(frozen=True)
class DivergedScene:
    """A scene that left the physical world, and what the simulation said of it."""

    name: str
    parameters: Mapping[str, float]
    message: str


def survivors(
    scenes: Sequence[Scene],
    run: Callable[[Sequence[Scene]], list[Done]],
    progress: Callable[[int], None] | None = None,
) -> list[Done | DivergedScene]:
    """The results of `run`, which simulates scenes together, with a DivergedScene in the place of each that diverges.

    progress  called with the number of scenes just done
    """
    found: list[Done | DivergedScene] = []
    for first in range(0, len(scenes), SCENES_OF_BATCH):
        found += _halved(scenes[first : first + SCENES_OF_BATCH], run, progress)
    return found


def _halved(
    scenes: Sequence[Scene], run: Callable[[Sequence[Scene]], list[Done]], progress: Callable[[int], None] | None
) -> list[Done | DivergedScene]:
    """One batch; in halves, again and again, where something in it diverges."""
    try:
        found: list[Done | DivergedScene] = [*run(scenes)]
    except SimulationDiverged as error:
        if len(scenes) > 1:
            middle = len(scenes) // 2
            return [*_halved(scenes[:middle], run, progress), *_halved(scenes[middle:], run, progress)]
        found = [DivergedScene(scenes[0].name, dict(scenes[0].parameters), str(error))]
    if progress:
        progress(len(scenes))
    return found
