"""What programs give to geometry: arrays of numbers, and meshes as files or as triangles."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any, TypeAlias

import numpy as np
from torch import Tensor

from pcnclaws.errors import UserError
from pcnclaws.geometry.meshes import ClosedSurface, closed_surface, read_surface

Array: TypeAlias = Tensor | np.ndarray | Sequence[Any]


def surface_of(source: str | Path | tuple[Array, Array], option: str = "scene.mesh") -> ClosedSurface:
    """The closed surface of a file that trimesh reads, or of vertices (V, 3) and triangles (F, 3).

    option  what messages call it
    raises  UserError, one line
    """
    if isinstance(source, str | Path):
        return read_surface(source, option)
    if not isinstance(source, tuple | list) or len(source) != 2:
        raise UserError(f"the mesh is a {type(source).__name__}; accepted: the path of a file, or (vertices, faces)")
    vertices = finite_array("vertices", source[0], (None, 3))
    faces = np.asarray(source[1].detach().cpu() if isinstance(source[1], Tensor) else source[1])
    if faces.dtype.kind not in "iu" or faces.ndim != 2 or faces.shape[1] != 3 or not len(faces):
        raise UserError(f"faces have the shape {faces.shape} of {faces.dtype}; accepted: whole numbers (F, 3)")
    faces = faces.astype(np.int64)
    if faces.min() < 0 or faces.max() >= len(vertices):
        raise UserError(f"faces name the vertices {faces.min()} to {faces.max()}; accepted: 0 to {len(vertices) - 1}")
    return closed_surface(vertices, faces, "(vertices, faces)", option)


def finite_array(name: str, values: Array | float, shape: tuple[int | None, ...]) -> np.ndarray:
    """Finite numbers of a shape in double precision; None stands for any length from 1."""
    if isinstance(values, Tensor):
        if values.requires_grad:
            raise UserError(f"{name} requires gradients, which a body does not carry; accepted: {name}.detach()")
        values = values.cpu().numpy()
    try:
        array = np.array(values)
    except ValueError:
        array = np.array(())
    wanted = "(N, 3)" if shape == (None, 3) else str(shape)
    right = array.ndim == len(shape) and all(
        a == b or (b is None and a > 0) for a, b in zip(array.shape, shape, strict=True)
    )
    if array.dtype.kind not in "fiu" or not right:
        raise UserError(f"{name} has the shape {array.shape} of {array.dtype}; accepted: numbers {wanted}")
    if not np.isfinite(array).all():
        raise UserError(f"{name} holds numbers that are not finite")
    return array.astype(np.float64)
