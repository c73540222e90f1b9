"""Initial conditions of scenes as the user knows them: particle-first NumPy arrays."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import TypeVar

import numpy as np
from jaxtyping import Float

from pcnclaws.errors import UserError
from pcnclaws.laws.materials import MATERIALS
from pcnclaws.laws.parameters import validate_parameters
from pcnclaws.mpm.settings import SimulationSettings
from pcnclaws.simulation.placement import require_inside
from pcnclaws.simulation.records import Keyframes, SceneRecord


@dataclass(frozen=True)
class Fall:
    """The start of a free fall that a scene may be in the midst of, and how many steps ago it was.

    position  [m], (particles, 3)
    velocity  [m/s], (particles, 3)
    """

    steps: int
    position: Float[np.ndarray, "particles 3"]
    velocity: Float[np.ndarray, "particles 3"]


@dataclass(frozen=True)
class SceneStart:
    """Where a scene starts: everything that a simulation needs but the laws.

    parameters   physical parameters by name
    position     [m], (particles, 3)
    velocity     [m/s], (particles, 3)
    volume       initial volume [m^3], (particles,)
    affine       APIC velocity gradient C [1/s], (particles, 3, 3), None for 0
    deformation  elastic deformation gradient F [-], (particles, 3, 3), None for I
    internal     internal variables by name, each (particles,), those of an undeformed body where they are missing
    density      of each particle [kg/m^3], (particles,), None where it is that of the settings
    loaded_at    positions by which loads act on particles [m], (particles, 3), None where it is their own: the first
                 ones of a run that starts later
    varying      physical parameters that differ between the particles, by name, each (particles,); what is recorded
                 of the scene does not hold them
    fall         of a scene that goes on from a later frame: the free fall that it goes on with, if it is one
    """

    name: str
    material: str
    settings: SimulationSettings
    parameters: Mapping[str, float]
    position: Float[np.ndarray, "particles 3"]
    velocity: Float[np.ndarray, "particles 3"]
    volume: Float[np.ndarray, " particles"]
    affine: Float[np.ndarray, "particles 3 3"] | None = None
    deformation: Float[np.ndarray, "particles 3 3"] | None = None
    density: Float[np.ndarray, " particles"] | None = None
    internal: Mapping[str, Float[np.ndarray, " particles"]] = field(default_factory=dict)
    loaded_at: Float[np.ndarray, "particles 3"] | None = None
    varying: Mapping[str, Float[np.ndarray, " particles"]] = field(default_factory=dict)
    fall: Fall | None = None

    @property
    def is_deformed(self) -> bool:
        """Whether the body starts with strain or internal variables of its own, which only a restart state can hold."""
        return self.deformation is not None or bool(self.internal)

    @property
    def lightest(self) -> SimulationSettings:
        """The settings with the density of the lightest particle, where waves are the fastest."""
        return self.settings if self.density is None else replace(self.settings, density=float(self.density.min()))

    def of_particles(self) -> dict[str, Float[np.ndarray, " particles"]]:
        """All physical parameters, of each particle, by name."""
        same = {name: np.full(len(self.position), value) for name, value in self.parameters.items()}
        return same | dict(self.varying)


Scene = TypeVar("Scene", SceneStart, SceneRecord)


def start_of(record: SceneRecord) -> SceneStart:
    """The start of a recorded scene: first frame, initial velocity and its gradient, or the keyframe at step 0.

    raises  UserError when the record does not say how the scene starts, or starts outside the domain
    """
    if record.initial_velocity is None:
        raise UserError(f"{record.label}: has no initial_velocity; a scene cannot start from it")
    if record.material in MATERIALS:
        names = MATERIALS[record.material].parameter_names
        known = {name: value for name, value in record.parameters.items() if name in names}
        validate_parameters(known, names, option=f"{record.label}: parameters")
    # a body that lies on a wall sinks half a cell into its layer, so that a recording may begin there
    require_inside(record.position[0], record.settings, record.label, slack=0.5 * record.settings.grid_spacing)
    start = SceneStart(
        record.name,
        record.material,
        record.settings,
        record.parameters,
        position=record.position[0],
        velocity=record.initial_velocity,
        volume=record.volume,
        affine=record.initial_affine,
        density=record.density,
        loaded_at=record.loaded_at,
    )
    keyframes = record.keyframes
    if keyframes is None or keyframes.step[0] != 0:
        return start
    # the first frame itself is where it starts
    return replace(restarted(start, keyframes, 0), position=start.position, velocity=start.velocity)


def restarted(start: SceneStart, keyframes: Keyframes, row: int) -> SceneStart:
    """The scene from one of its keyframes on: colliders and loads are where they are by then."""
    settings, step = start.settings, int(keyframes.step[row])
    return replace(
        start,
        settings=replace(settings, start_time=settings.time_at(step)) if settings.changes and step else settings,
        loaded_at=(start.position if start.loaded_at is None else start.loaded_at) if settings.loads else None,
        position=keyframes.position[row],
        velocity=keyframes.velocity[row],
        affine=keyframes.affine[row],
        deformation=keyframes.deformation[row],
        internal={name: values[row] for name, values in keyframes.internal.items()},
    )


def group_by_settings(scenes: Sequence[Scene]) -> list[list[Scene]]:
    """The scenes in groups that can run as one batch, in the order of their first members."""
    groups: dict[SimulationSettings, list[Scene]] = {}
    for scene in scenes:
        groups.setdefault(_shared(scene.settings), []).append(scene)
    return list(groups.values())


def _shared(settings: SimulationSettings) -> SimulationSettings:
    """The settings but for what may differ within a batch."""
    same = replace(settings, gravity=(0.0, 0.0, 0.0), density=1.0)
    return same if settings.changes else replace(same, start_time=0.0)
