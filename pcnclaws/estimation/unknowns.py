"""Unknowns of an estimation: which numbers are sought, and what they make of the particles of a scene.

A physical parameter may be one number for the whole scene, one for each body, or two at the ends of a graded body: its
values at the particles are always a sum of numbers times fixed shares (particles,), and so are start velocities.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int64
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial import KDTree

from pcnclaws.errors import UserError, unknown_name
from pcnclaws.estimation.transforms import Free, Transform, transform_of
from pcnclaws.geometry.velocity_gradients import spin_gradient
from pcnclaws.laws.parameters import PARAMETERS

VARIATIONS = ("uniform", "bodies", "x", "y", "z")
# Scales of start velocities [m/s], spins [rad/s], the offset of the clock [s] and of the surface [m]: changes of this
# size matter alike.
VELOCITY_SCALE, SPIN_SCALE, OFFSET_SCALE, SURFACE_SCALE = 1.0, 4.0, 1e-2, 1e-2
MOTION = ("velocity_x", "velocity_y", "velocity_z", "spin_x", "spin_y", "spin_z")
TIME_OFFSET = "time_offset"
SURFACE_OFFSET = "surface_offset"
# Displacement of walls and colliders along the axes [m], friction of the walls [-], turns of gravity [deg], by how much
# the body is larger than given [-].
WALLS = ("walls_x", "walls_y", "walls_z")
FRICTION = "wall_friction"
TILTS = ("tilt_1", "tilt_2")
SIZE = "size"
SURROUNDINGS = (*WALLS, FRICTION, *TILTS, SIZE)
# The spacing of the grid that the motion is most like [m]; it is sought by estimation/refinement.py alone.
GRID_SPACING = "grid_spacing"
WALL_SCALE, TILT_SCALE, SIZE_SCALE, GRID_SCALE = 1e-2, 1.0, 0.05, 1e-2
# An interval that is as wide as this tells nothing of them.
WIDEST_SURROUNDINGS = dict.fromkeys(WALLS, 0.05) | {FRICTION: 0.5} | dict.fromkeys(TILTS, 20.0) | {SIZE: 0.3}
# Friction of walls is sought between these [-].
LEAST_FRICTION, MOST_FRICTION, LONGEST_FRICTION = 0.0, 2.0, 0.3


@dataclass(frozen=True)
class Component:
    """A part of the scene that has numbers of its own: a body, or the end of a graded one.

    name   '' where there is but one
    share  of each particle, (particles,), which sum to 1 over the components
    """

    name: str
    share: Float[np.ndarray, " particles"]


@dataclass(frozen=True)
class Unknown:
    """One number that is sought.

    name       youngs_modulus, ...; velocity_x, ..., spin_z; time_offset, surface_offset, grid_spacing, or one of
               SURROUNDINGS
    component  the part of the scene that it belongs to, None for the clock, the surface, the grid and the surroundings
    """

    name: str
    component: Component | None
    transform: Transform | Free

    @property
    def label(self) -> str:
        """The name with its component, as it is printed: youngs_modulus[body_0]."""
        return f"{self.name}[{self.component.name}]" if self.component and self.component.name else self.name

    @property
    def is_motion(self) -> bool:
        """Whether it is a start velocity or a spin."""
        return self.name in MOTION

    def rigid_velocity(
        self, point: Float[np.ndarray, "points 3"], position: Float[np.ndarray, "particles 3"]
    ) -> Float[np.ndarray, "points 3"]:
        """Velocities of points of the body for a unit of a start velocity, or of a spin about the body's centre.

        position  of the particles at the start [m]
        """
        share = self.component.share if self.component else np.ones(len(position))
        axis = np.broadcast_to(np.eye(3)["xyz".index(self.name[-1])], point.shape)
        if self.name.startswith("velocity"):
            return axis
        return np.cross(axis, point - np.average(position, axis=0, weights=share))

    def velocity_gradient(self) -> Float[np.ndarray, "3 3"]:
        """The gradient of rigid_velocity: none of a start velocity, that of the rotation of a spin."""
        if not self.name.startswith("spin"):
            return np.zeros((3, 3))
        return spin_gradient(np.eye(3)["xyz".index(self.name[-1])].tolist())


@dataclass(frozen=True)
class Unknowns:
    """All unknowns in their order, and the physical parameters that are known.

    fixed  by name, each (particles,)
    """

    sought: tuple[Unknown, ...]
    fixed: Mapping[str, Float[np.ndarray, " particles"]]

    def __len__(self) -> int:
        return len(self.sought)

    def values(self, coordinates: Float[np.ndarray, " unknowns"]) -> Float[np.ndarray, " unknowns"]:
        """The numbers in their units."""
        pairs = zip(self.sought, coordinates, strict=True)
        return np.array([unknown.transform.value(np.array([u]))[0] for unknown, u in pairs])

    def slopes(self, coordinates: Float[np.ndarray, " unknowns"]) -> Float[np.ndarray, " unknowns"]:
        """d number / d coordinate."""
        pairs = zip(self.sought, coordinates, strict=True)
        return np.array([unknown.transform.slope(np.array([u]))[0] for unknown, u in pairs])

    def reach(self, coordinates: Float[np.ndarray, " unknowns"]) -> Float[np.ndarray, "2 unknowns"]:
        """How far down and up each coordinate may go at once."""
        pairs = zip(self.sought, coordinates.tolist(), strict=True)
        return np.array([unknown.transform.reach(u) for unknown, u in pairs]).T

    def coordinates(self, values: Sequence[float]) -> Float[np.ndarray, " unknowns"]:
        """The coordinates of numbers inside their bounds."""
        return np.array([unknown.transform.coordinate(v) for unknown, v in zip(self.sought, values, strict=True)])

    def parameters(self, values: Float[np.ndarray, " unknowns"]) -> dict[str, Float[np.ndarray, " particles"]]:
        """The physical parameters of the particles."""
        result = {name: np.array(known) for name, known in self.fixed.items()}
        for unknown, value in zip(self.sought, values.tolist(), strict=True):
            if unknown.name in PARAMETERS and unknown.component is not None:
                result[unknown.name] = result.get(unknown.name, 0.0) + value * unknown.component.share
        return result

    def index(self, name: str) -> list[int]:
        """Numbers of the unknowns of that name."""
        return [k for k, unknown in enumerate(self.sought) if unknown.name == name]

    @property
    def motion(self) -> list[int]:
        """Numbers of the start velocities and spins."""
        return [k for k, unknown in enumerate(self.sought) if unknown.is_motion]

    @property
    def surroundings(self) -> list[int]:
        """Numbers of what stands around the body, and of its size."""
        return [k for k, unknown in enumerate(self.sought) if unknown.name in SURROUNDINGS]

    @property
    def physical(self) -> list[int]:
        """Numbers of the physical parameters."""
        return [k for k, unknown in enumerate(self.sought) if unknown.name in PARAMETERS]


def make_unknowns(
    names: Sequence[str],
    fixed: Mapping[str, float],
    components: Sequence[Component],
    bodies: Sequence[Component],
    *,
    motion: bool,
    time_offset: bool,
    surface_offset: bool = False,
    walls: bool = False,
    friction: bool = False,
    gravity: bool = False,
    size: bool = False,
    grid_spacing: bool = False,
) -> Unknowns:
    """The unknowns of a scene.

    names           physical parameters of the material
    fixed           those of them that are known, by name
    components      where the physical parameters vary
    bodies          each of which moves on its own
    motion          whether start velocities and spins are sought, too
    time_offset     whether the clock of the observation is
    surface_offset  whether it is sought how far the surface is from where the volume of the body puts it
    walls           whether it is sought where walls and colliders are
    friction        whether the friction of the walls is sought
    gravity         whether it is sought which way gravity points
    size            whether the size of the body is sought
    grid_spacing    whether the spacing of the grid that the motion is most like is
    raises          UserError where nothing is left to estimate
    """
    for name in fixed:
        if name not in names:
            raise unknown_name("fixed", name, names)
    free = [name for name in names if name not in fixed]
    if not free:
        raise UserError(f"fixed={dict(fixed)} leaves nothing to estimate; accepted: at most {len(names) - 1} of them")
    sought = [Unknown(name, component, transform_of(PARAMETERS[name])) for name in free for component in components]
    if motion:
        scales = dict.fromkeys(MOTION[:3], VELOCITY_SCALE) | dict.fromkeys(MOTION[3:], SPIN_SCALE)
        sought += [Unknown(name, body, Free(scale)) for body in bodies for name, scale in scales.items()]
    if time_offset:
        sought.append(Unknown(TIME_OFFSET, None, Free(OFFSET_SCALE)))
    if surface_offset:
        sought.append(Unknown(SURFACE_OFFSET, None, Free(SURFACE_SCALE)))
    sought += [Unknown(name, None, Free(WALL_SCALE)) for name in WALLS if walls]
    if friction:
        sought.append(Unknown(FRICTION, None, Transform(LEAST_FRICTION, MOST_FRICTION, LONGEST_FRICTION)))
    sought += [Unknown(name, None, Free(TILT_SCALE)) for name in TILTS if gravity]
    if size:
        sought.append(Unknown(SIZE, None, Free(SIZE_SCALE)))
    if grid_spacing:
        sought.append(Unknown(GRID_SPACING, None, Free(GRID_SCALE)))
    particles = len(components[0].share)
    return Unknowns(tuple(sought), {name: np.full(particles, value) for name, value in fixed.items()})


def components_of(vary: str, position: Float[np.ndarray, "particles 3"], spacing: float) -> list[Component]:
    """The components of a scene for the option `vary`.

    position  of the particles at the start [m]
    spacing   distance of neighbouring particles [m]: bodies are further apart
    """
    if vary not in VARIATIONS:
        raise unknown_name("vary", vary, VARIATIONS)
    particles = len(position)
    if vary == "uniform":
        return [Component("", np.ones(particles))]
    if vary == "bodies":
        label = connected_bodies(position, spacing)
        count = int(label.max()) + 1
        return [Component(f"body_{k}" if count > 1 else "", (label == k).astype(float)) for k in range(count)]
    along = position[:, "xyz".index(vary)]
    share = (along - along.min()) / max(float(np.ptp(along)), 1e-12)
    return [Component(f"low_{vary}", 1.0 - share), Component(f"high_{vary}", share)]


def connected_bodies(position: Float[np.ndarray, "particles 3"], spacing: float) -> Int64[np.ndarray, " particles"]:
    """The body of each particle, numbered along x: particles nearer than 1.8 spacings belong together."""
    pairs = KDTree(position).query_pairs(1.8 * spacing, output_type="ndarray")
    shape = (len(position), len(position))
    graph = coo_array((np.ones(len(pairs)), (pairs[:, 0], pairs[:, 1])), shape=shape)
    count, label = connected_components(graph, directed=False)
    centres = [position[label == k, 0].mean() for k in range(count)]
    rank = np.argsort(np.argsort(centres))
    return rank[label].astype(np.int64)
