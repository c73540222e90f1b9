"""Synthetic observations: what cameras would see of a simulated motion.

Before an experiment it answers which parameters its motion, its markers and its noise can tell.
"""

from pathlib import Path

import numpy as np
from jaxtyping import Float

from pcnclaws.commands.configuration import whole_number
from pcnclaws.commands.outputs import TABLE, output_file
from pcnclaws.commands.recorded_motion import recorded_scene
from pcnclaws.commands.typed_configs import ObserveConfig
from pcnclaws.data.markers import surface_particles
from pcnclaws.data.observation_files import DOUBLE_DIGITS, SINGLE_DIGITS, write_table
from pcnclaws.errors import UserError
from pcnclaws.rendering.pictures import picture_path, trajectory_picture
from pcnclaws.simulation.records import SceneRecord


def observe(config: ObserveConfig) -> None:
    """Writes the markers of a recorded motion as a CSV file to `output`, and a picture of them beside it."""
    output = output_file(config.output, {"file": config.file}, *TABLE)
    record = recorded_scene(config.file, config.scene, "file", with_keyframes=False)
    chance = np.random.default_rng(whole_number(config.seed, "seed", least=0))
    marker = _chosen(config, record, chance)
    frames = np.arange(0, len(record.time), whole_number(config.every, "every"))
    if len(frames) == 1:
        raise UserError(f"every={config.every} sees the start alone; accepted: 1 to {max(len(record.time) - 1, 1)}")
    position = record.position[frames][:, marker].astype(np.float64)
    position += _share(config, "noise", 1.0) * chance.standard_normal(position.shape)
    unseen = chance.random(position.shape[:2]) < _share(config, "missing", 1.0)
    unseen[0] = False  # where each marker has its place on the body
    position[unseen] = np.nan
    time = record.time[frames] - record.time[0]
    names = [f"p{particle}" for particle in marker.tolist()]
    picture = _picture(record, time, position, marker, output) if config.picture else None
    digits = DOUBLE_DIGITS if record.position.dtype == np.float64 else SINGLE_DIGITS
    write_table(output, time, names, position, digits)
    print(
        f"wrote {output}: {len(marker)} markers in {len(frames)} frames of '{record.name}', {unseen.mean():.0%} unseen"
    )
    if picture:
        print(f"wrote {picture}")


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
    time: Float[np.ndarray, " frames"],
    position: Float[np.ndarray, "frames markers 3"],
    marker: np.ndarray,
    output: Path,
) -> Path:
    seen = SceneRecord(
        f"{record.name}, markers",
        record.material,
        record.settings,
        record.parameters,
        time=time,
        position=position,
        volume=record.volume[marker],
    )
    return trajectory_picture(seen, picture_path(output))
