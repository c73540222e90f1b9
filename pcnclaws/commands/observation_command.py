"""Synthetic observations: what cameras would see of a simulated motion.

Before an experiment it answers which parameters its motion, its markers and its noise can tell.
"""

from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float

from pcnclaws.commands.configuration import whole_number
from pcnclaws.commands.outputs import TABLE, output_file
from pcnclaws.commands.recorded_motion import recorded_scene
from pcnclaws.commands.typed_configs import ObserveConfig
from pcnclaws.data.markers import surface_particles
from pcnclaws.data.observation_files import DOUBLE_DIGITS, SINGLE_DIGITS, write_table
from pcnclaws.data.point_frames import POINT_FRAMES, PointFrames, write_point_frames
from pcnclaws.data.point_observation import surface_vertices
from pcnclaws.errors import UserError, unknown_name
from pcnclaws.geometry.particle_surface import particle_surface
from pcnclaws.geometry.surface_views import seen_points
from pcnclaws.rendering.pictures import picture_path, trajectory_picture
from pcnclaws.simulation.particle_spacing import particle_spacing
from pcnclaws.simulation.records import SceneRecord

KINDS = ("markers", "points")


def observe(config: ObserveConfig) -> None:
    """Writes markers or points of a recorded motion to `output`, and a picture of them beside it."""
    if config.kind not in KINDS:
        raise unknown_name("kind", config.kind, KINDS)
    endings = POINT_FRAMES if config.kind == "points" else TABLE
    output = output_file(config.output, {"file": config.file}, *endings)
    record = recorded_scene(config.file, config.scene, "file", with_keyframes=False)
    chance = np.random.default_rng(whole_number(config.seed, "seed", least=0))
    frames = np.arange(0, len(record.time), whole_number(config.every, "every"))
    if len(frames) == 1:
        raise UserError(f"every={config.every} sees the start alone; accepted: 1 to {max(len(record.time) - 1, 1)}")
    if config.kind == "points":
        _observe_points(config, record, frames, chance, output=output)
    else:
        _observe_markers(config, record, frames, chance, output=output)


def _observe_markers(
    config: ObserveConfig, record: SceneRecord, frames: np.ndarray, chance: np.random.Generator, *, output: Path
) -> None:
    marker = _chosen(config, record, chance)
    position = record.position[frames][:, marker].astype(np.float64)
    position += _share(config, "noise", 1.0) * chance.standard_normal(position.shape)
    unseen = chance.random(position.shape[:2]) < _share(config, "missing", 1.0)
    unseen[0] = False  # where each marker has its place on the body
    position[unseen] = np.nan
    time = record.time[frames] - record.time[0]
    names = [f"p{particle}" for particle in marker.tolist()]
    picture = _picture(record, "markers", time, position, output) if config.picture else None
    digits = DOUBLE_DIGITS if record.position.dtype == np.float64 else SINGLE_DIGITS
    write_table(output, time, names, position, digits)
    print(
        f"wrote {output}: {len(marker)} markers in {len(frames)} frames of '{record.name}', {unseen.mean():.0%} unseen"
    )
    if picture:
        print(f"wrote {picture}")


def _observe_points(
    config: ObserveConfig, record: SceneRecord, frames: np.ndarray, chance: np.random.Generator, *, output: Path
) -> None:
    """Points of the surface, other ones in each frame."""
    start, volume = record.position[0].astype(np.float64), record.volume.astype(np.float64)
    surface = particle_surface(start, volume, particle_spacing(start, volume))
    vertices = surface_vertices(surface, np.concatenate((start[None], record.position[frames].astype(np.float64))))[1:]
    count, towards = whole_number(config.points, "points"), _direction(config.camera)
    noise, missing = _share(config, "noise", 1.0), _share(config, "missing", 1.0)
    found = [
        seen_points(one, surface.faces, chance.poisson(count * (1.0 - missing)), towards, chance) for one in vertices
    ]
    counts = [len(one) for one in found]
    position = np.concatenate(found)
    position += noise * chance.standard_normal(position.shape)
    seen = PointFrames(record.time[frames] - record.time[0], position, np.repeat(np.arange(len(frames)), counts))
    picture = _picture(record, "points", seen.time, seen.by_frame(), output) if config.picture else None
    files = write_point_frames(output, seen)
    words = str(output) if len(files) == 1 else f"{files[0]} to {files[-1].name}"
    print(f"wrote {words}: {min(counts)} to {max(counts)} points in each of {len(frames)} frames of '{record.name}'")
    if picture:
        print(f"wrote {picture}")


def _direction(camera: Any) -> Float[np.ndarray, "3"] | None:
    if camera is None:
        return None
    numbers = isinstance(camera, list) and all(isinstance(x, (int, float)) and not isinstance(x, bool) for x in camera)
    if not numbers or len(camera) != 3 or not np.isfinite(camera).all() or not any(camera):
        raise UserError(f"camera={camera} is not accepted; accepted: [x, y, z] from the body to the camera, or null")
    return np.array(camera, dtype=np.float64)


def _chosen(config: ObserveConfig, record: SceneRecord, chance: np.random.Generator) -> np.ndarray:
    """The particles that carry a marker, in increasing order."""
    particles = np.arange(record.position.shape[1])
    if config.surface:
        particles = particles[surface_particles(record.position[0].astype(np.float64))]
    count = round(_share(config, "markers", 1.0) * record.position.shape[1])
    if not 1 <= count <= len(particles):
        where = "surface particles" if config.surface else "particles"
        raise UserError(
            f"markers={config.markers:g} is {count} markers; accepted: 1 to {len(particles)}, the number of {where}"
        )
    return np.sort(chance.choice(particles, count, replace=False))


def _share(config: ObserveConfig, option: str, most: float) -> float:
    value = getattr(config, option)
    if isinstance(value, bool) or not isinstance(value, (int, float)) or not 0.0 <= value <= most:
        raise UserError(f"{option}={value} is not accepted; accepted: a number from 0 to {most:g}")
    return float(value)


def _picture(
    record: SceneRecord,
    what: str,
    time: Float[np.ndarray, " frames"],
    position: Float[np.ndarray, "frames positions 3"],
    output: Path,
) -> Path:
    seen = SceneRecord(
        f"{record.name}, {what}",
        record.material,
        record.settings,
        record.parameters,
        time=time,
        position=position,
        volume=np.full(position.shape[1], record.volume.mean()),
    )
    return trajectory_picture(seen, picture_path(output))
