"""Observations of unlabelled points: frames of them, and the surface of the body that they are on."""

from pathlib import Path

import numpy as np
from jaxtyping import Float, Int64
from scipy.spatial import KDTree

from pcnclaws.data.length_units import UNITS
from pcnclaws.data.observation import Observation, ObservedPoints
from pcnclaws.data.observation_files import require_metres
from pcnclaws.data.point_frames import PointFrames, read_point_frames
from pcnclaws.data.units import check_steps
from pcnclaws.errors import UserError
from pcnclaws.geometry.particle_surface import ParticleSurface, face_normals, particle_surface
from pcnclaws.geometry.shapes import PointCloud
from pcnclaws.mpm.settings import SimulationSettings
from pcnclaws.simulation.particle_spacing import particle_spacing
from pcnclaws.simulation.placement import require_inside

# Particles around a vertex that tell how the body deforms there: it and those around it in a lattice.
AROUND = 9
# Edge of a patch of the surface, in spacings: errors in one patch are taken to be alike.
PATCH = 3.0
# Frames this near to the start are at the start [s].
AT_START = 1e-6
# Later points may be so many lengths of the body from the middle of their frame, and no body has parts farther away.
FARTHEST = 2.0


def from_points(
    path: str | Path,
    material: str,
    settings: SimulationSettings,
    body: PointCloud,
    velocity_known: bool,
    units: str = "m",
    start: float = 0.0,
) -> Observation:
    """The points of a file on the surface of a body of known shape and place.

    body            the particles at time 0, the start of the simulation
    velocity_known  whether the body's velocities are those of the start
    units           of the file's lengths, one of UNITS
    start           of the simulation on the clock of the file [s]; what comes before is not used
    raises          UserError, one line, for a file that cannot be used and for points that are not on the body
    """
    path = Path(path)
    frames = _from_start(path, read_point_frames(path), start)
    position = UNITS[units] * frames.position
    require_inside(body.position, settings, "scene")
    require_metres(position, str(path), settings)
    check_steps(str(path), frames.time, settings)
    spacing = particle_spacing(body.position, body.volume)
    surface = particle_surface(body.position, body.volume, spacing)
    _require_on_body(path, frames._replace(position=position), body, settings.grid_spacing + abs(surface.offset))
    particle, weight = surface_markers(surface, body.position)
    return Observation(
        path.stem.replace("*", "").strip("_-. ") or "points",
        material,
        settings,
        time=frames.time,
        target=np.full((len(frames.time), len(particle), 3), np.nan),
        particle=particle,
        weight=weight,
        position=body.position,
        volume=body.volume,
        initial_velocity=body.velocity if velocity_known else None,
        truth={},
        initial_affine=body.affine if velocity_known else None,
        density=body.density,
        points=observed_points(position, frames.frame, surface, body.position[surface.particle], spacing),
    )


def surface_markers(
    surface: ParticleSurface, position: Float[np.ndarray, "particles 3"]
) -> tuple[Int64[np.ndarray, "markers followed"], Float[np.ndarray, "markers followed"]]:
    """Two markers for each vertex of a surface: its particle, and how it moves where the surface moves out by 1.

    The latter turns and stretches as the body around it does, by least squares.
    """
    count = min(AROUND, len(position))
    around = KDTree(position).query(position[surface.particle], k=count)[1].reshape(-1, count).astype(np.int64)
    apart = position[around] - position[around].mean(1, keepdims=True)
    gradient = np.linalg.pinv(apart, rcond=1e-6)
    outward = np.einsum("vc,vck->vk", surface.outward, gradient)
    own = np.zeros_like(outward)
    own[:, 0] = 1.0
    first = np.concatenate((surface.particle[:, None], around[:, 1:]), axis=1)
    return np.concatenate((first, around)), np.concatenate((own, outward))


def surface_vertices(
    surface: ParticleSurface, position: Float[np.ndarray, "frames particles 3"]
) -> Float[np.ndarray, "frames vertices 3"]:
    """The vertices of a surface as its body moves [m].

    position  of the particles [m], the first frame undeformed
    """
    particle, weight = surface_markers(surface, position[0])
    place, outward = np.split(np.einsum("mk,fmkc->fmc", weight, position[:, particle]), 2, axis=1)
    return place + surface.offset * outward


def observed_points(
    position: Float[np.ndarray, "points 3"],
    frame: Int64[np.ndarray, " points"],
    surface: ParticleSurface,
    vertices: Float[np.ndarray, "vertices 3"],
    spacing: float,
) -> ObservedPoints:
    """Points on a surface, whose patches are boxes of triangles that face the same way."""
    corners = vertices[surface.faces]
    normal = face_normals(corners)
    side = np.abs(normal).argmax(1)
    facing = 2 * side + (np.take_along_axis(normal, side[:, None], 1)[:, 0] > 0.0)
    box = np.floor((corners.mean(1) - vertices.min(0)) / (PATCH * spacing)).astype(np.int64)
    patch = np.unique(np.column_stack((facing, box)), axis=0, return_inverse=True)[1]
    return ObservedPoints(position, frame, surface.faces, patch.reshape(-1).astype(np.int64), surface.offset)


def _from_start(path: Path, frames: PointFrames, start: float) -> PointFrames:
    """Frames with times since the start of the simulation, from then on."""
    kept = frames.time >= start - AT_START
    if not kept.any() or frames.time[-1] <= start + AT_START:
        raise UserError(
            f"{path}: its times end at {frames.time[-1]:g} s; accepted: frames after the start, at {start:g} s "
            "(observation.start)"
        )
    mine = kept[frames.frame]
    time = np.maximum(frames.time[kept] - start, 0.0)
    return PointFrames(time, frames.position[mine], (np.cumsum(kept) - 1)[frames.frame[mine]].astype(np.int64))


def _require_on_body(path: Path, frames: PointFrames, body: PointCloud, reach: float) -> None:
    """Refuses points of the start that are off the body, and later ones that are far from all others."""
    length = float(np.linalg.norm(np.ptp(body.position, axis=0)))
    for number, time in enumerate(frames.time.tolist()):
        point = frames.position[frames.frame == number]
        if time <= AT_START:
            distance = KDTree(body.position).query(point)[0]
            what, most = "nearest particle", reach
        else:
            distance = np.linalg.norm(point - np.median(point, axis=0), axis=1)
            what, most = "middle of its frame", FARTHEST * length
        far = int(np.argmax(distance))
        if distance[far] > most:
            shown = ", ".join(f"{x:.4g}" for x in point[far])
            raise UserError(
                f"{path}: point ({shown}) m at {time:g} s is {distance[far]:.3g} m from the {what}, "
                f"{np.count_nonzero(distance > most)} of {len(point)} are; accepted: points on the body, at "
                f"most {most:.3g} m{_extents(point, body)}"
            )


def _extents(point: Float[np.ndarray, "points 3"], body: PointCloud) -> str:
    """A hint where the points span far more or far less than the body."""
    points, bodies = (float(np.ptp(one, axis=0).max()) for one in (point, body.position))
    if bodies / 3.0 < points < 3.0 * bodies:
        return ""
    return f"; the points span {points:.3g} m and the body {bodies:.3g} m: in another unit?"
