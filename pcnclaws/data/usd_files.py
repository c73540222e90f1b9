"""A recorded motion as Universal Scene Description: points with a time sample for each frame."""

import importlib
import tempfile
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np

from pcnclaws.atomic import replaced_file
from pcnclaws.data.scene_notes import MARK, line_of, notes_of
from pcnclaws.errors import not_installed
from pcnclaws.simulation.particle_fields import ParticleFields

ROOT = "/particles"
# Attributes of the points themselves; the other fields are primvars.
OWN = ("id", "velocity")


def require_usd() -> Any:
    """The modules of usd-core; UserError with the way to install it where it is missing."""
    try:
        return SimpleNamespace(
            **{name: importlib.import_module(f"pxr.{name}") for name in ("Sdf", "Usd", "UsdGeom", "Vt")}
        )
    except ImportError as error:
        otherwise = "a file that ends in .ply, .pvd, .npz or .csv"
        raise not_installed("a USD file", "usd-core", "usd", otherwise) from error


def write_usd(path: Path, fields: ParticleFields) -> None:
    """Writes a stage in metres with the points /particles, y up: .usda as text, .usd and .usdc binary.

    A frame is a time code, and the time codes of a second are those of the motion. Points have positions, velocities,
    widths (the edges of the cubes that particles stand for) and ids, in single precision as the format has it; other
    fields are primvars of vertices, tensors as matrices whose rows are those of the tensor. Particles that were not
    observed in a frame are not among its points.
    """
    usd, record = require_usd(), fields.record
    with tempfile.TemporaryDirectory() as folder:
        part = Path(folder) / f"stage{path.suffix.lower()}"
        stage = usd.Usd.Stage.CreateNew(str(part))
        usd.UsdGeom.SetStageUpAxis(stage, usd.UsdGeom.Tokens.y)
        usd.UsdGeom.SetStageMetersPerUnit(stage, 1.0)
        points = usd.UsdGeom.Points.Define(stage, ROOT)
        stage.SetDefaultPrim(points.GetPrim())
        last = len(record.time) - 1
        stage.SetStartTimeCode(0)
        stage.SetEndTimeCode(last)
        if last:
            stage.SetTimeCodesPerSecond(last / float(record.time[-1] - record.time[0]))
        stage.GetRootLayer().customLayerData = {MARK: line_of(notes_of(record)).removeprefix(f"{MARK} ")}
        for frame in range(last + 1):
            _write_frame(usd, points, fields, frame)
        stage.GetRootLayer().Save()
        del stage
        content = part.read_bytes()
    with replaced_file(path) as unfinished:
        unfinished.write(content)


def _write_frame(usd: Any, points: Any, fields: ParticleFields, frame: int) -> None:
    seen = fields.seen(frame)
    values = {name: one[seen] for name, one in fields.at(frame).items()}
    vectors = usd.Vt.Vec3fArray.FromNumpy
    points.CreatePointsAttr().Set(vectors(_single(fields.record.position[frame][seen])), frame)
    points.CreateIdsAttr().Set(usd.Vt.Int64Array.FromNumpy(values["id"].astype(np.int64)), frame)
    points.CreateWidthsAttr().Set(usd.Vt.FloatArray.FromNumpy(_single(np.cbrt(values["volume"]))), frame)
    if "velocity" in values:
        points.CreateVelocitiesAttr().Set(vectors(_single(values["velocity"])), frame)
    primvars = usd.UsdGeom.PrimvarsAPI(points)
    for name, one in values.items():
        if name in OWN:
            continue
        if one.ndim == 3:
            kind, array = usd.Sdf.ValueTypeNames.Matrix3dArray, usd.Vt.Matrix3dArray.FromNumpy(one.astype(np.float64))
        else:
            kind, array = usd.Sdf.ValueTypeNames.FloatArray, usd.Vt.FloatArray.FromNumpy(_single(one))
        primvars.CreatePrimvar(name, kind, usd.UsdGeom.Tokens.vertex).Set(array, frame)


def _single(values: np.ndarray) -> np.ndarray:
    return np.ascontiguousarray(values, dtype=np.float32)
