"""Surface of a body of particles: the triangles around it, and how far off the outermost particles it is."""

from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Int64
from scipy.optimize import root_scalar
from scipy.spatial import Delaunay

from pcnclaws.errors import UserError

# Particles belong together up to this distance, in spacings: the diagonal of a cell of a lattice, and a little more.
REACH = 1.8
# Lattices are shaken by this before they are cut into tetrahedra, in spacings; flatter ones than that are no volume.
SHAKE, FLAT = 1e-5, 1e-3
# A sharp corner is not moved out farther than where three faces meet at right angles.
SHARPEST = 0.1

Corners = Int64[np.ndarray, "faces 3"]


class ParticleSurface(NamedTuple):
    """The surface of an undeformed body: vertices position[particle] + offset * outward.

    particle  of each vertex, (vertices,)
    faces     vertices of each triangle, counterclockwise seen from outside, (faces, 3)
    outward   by how much a vertex moves where each face around it moves out by 1 [-], (vertices, 3)
    offset    of the faces from the outermost particles [m], such that the volume of the particles is inside
    """

    particle: Int64[np.ndarray, " vertices"]
    faces: Corners
    outward: Float[np.ndarray, "vertices 3"]
    offset: float


def particle_surface(
    position: Float[np.ndarray, "particles 3"], volume: Float[np.ndarray, " particles"], spacing: float
) -> ParticleSurface:
    """The surface of a body: the boundary of the Delaunay tetrahedra whose edges are of neighbouring particles.

    position  of the particles at the start [m]
    volume    [m^3]
    spacing   distance of neighbouring particles [m]
    raises    UserError for particles that have no inside
    source    Edelsbrunner and Muecke 1994, "Three-dimensional alpha shapes"; here lengths of edges decide
    """
    corner = _outer_faces(position, spacing)
    particle, faces = np.unique(corner, return_inverse=True)
    faces = faces.reshape(-1, 3).astype(np.int64)
    vertices = position[particle]
    outward = _outward(vertices, faces)
    return ParticleSurface(
        particle.astype(np.int64), faces, outward, _offset(vertices, faces, outward, volume, spacing)
    )


def face_normals(corners: Float[np.ndarray, "... 3 3"]) -> Float[np.ndarray, "... 3"]:
    """Normals of triangles, (..., 3), with the lengths of twice their areas."""
    return np.cross(corners[..., 1, :] - corners[..., 0, :], corners[..., 2, :] - corners[..., 0, :])


def _outer_faces(position: Float[np.ndarray, "particles 3"], spacing: float) -> Corners:
    """Particles of the triangles that belong to one tetrahedron alone, counterclockwise seen from outside."""
    if len(position) < 4 or np.linalg.matrix_rank(position - position.mean(0), tol=FLAT * spacing) < 3:
        raise UserError(f"scene: its {len(position)} particles have no inside; accepted: a body with a surface")
    shaken = position + SHAKE * spacing * np.random.default_rng(0).standard_normal(position.shape)
    cut = Delaunay(shaken)
    corner, neighbour = cut.simplices.astype(np.int64), cut.neighbors
    place = position[corner]
    edges = place[:, :, None] - place[:, None]
    outside = np.square(edges).sum(3).max((1, 2)) > (REACH * spacing) ** 2
    flat = np.abs(np.linalg.det(place[:, 1:] - place[:, :1])) < FLAT * spacing**3
    while True:  # flat ones are no part of the body where the outside reaches them
        reached = flat & ~outside & ((neighbour < 0) | outside[neighbour]).any(1)
        if not reached.any():
            break
        outside |= reached
    inside = np.flatnonzero(~outside)
    if not len(inside):
        raise UserError(f"scene: its {len(position)} particles are too far apart to have a surface")
    which, opposite = np.nonzero((neighbour[inside] < 0) | outside[neighbour[inside]])
    whole = corner[inside[which]]
    faces = whole[np.arange(4) != opposite[:, None]].reshape(-1, 3)
    inner = position[whole[np.arange(len(whole)), opposite]]
    turned = np.sum(face_normals(position[faces]) * (inner - position[faces[:, 0]]), axis=1) > 0.0
    faces[turned] = faces[turned][:, ::-1]
    return faces


def _outward(vertices: Float[np.ndarray, "vertices 3"], faces: Corners) -> Float[np.ndarray, "vertices 3"]:
    """The vectors m with n . m = 1 for the normals n of the faces around each vertex, by least squares over areas."""
    normal = face_normals(vertices[faces])
    area = np.linalg.norm(normal, axis=1)
    unit = normal / np.maximum(area, 1e-300)[:, None]
    spread, sum_of = np.zeros((len(vertices), 3, 3)), np.zeros((len(vertices), 3))
    for corner in faces.T:
        np.add.at(spread, corner, area[:, None, None] * unit[:, :, None] * unit[:, None, :])
        np.add.at(sum_of, corner, area[:, None] * unit)
    return np.einsum("vij,vj->vi", np.linalg.pinv(spread, rcond=SHARPEST, hermitian=True), sum_of)


def _offset(
    vertices: Float[np.ndarray, "vertices 3"],
    faces: Corners,
    outward: Float[np.ndarray, "vertices 3"],
    volume: Float[np.ndarray, " particles"],
    spacing: float,
) -> float:
    total = float(volume.sum())

    def lacking(offset: float) -> float:
        moved = (vertices + offset * outward - vertices.mean(0))[faces]
        return float(np.sum(moved[:, 0] * face_normals(moved)) / 6.0) - total

    if abs(lacking(0.0)) < 1e-6 * total:
        return 0.0
    least, most = -0.5 * spacing, spacing
    if lacking(least) * lacking(most) > 0.0:
        return 0.0
    return float(root_scalar(lacking, bracket=(least, most), xtol=1e-6 * spacing).root)
