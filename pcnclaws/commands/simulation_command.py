"""Simulation of one scene, from its typed options to the trajectory file and its picture."""

import logging
from dataclasses import replace
from pathlib import Path

from pcnclaws.commands.configuration import (
    execution_from,
    start_from,
    use_processor,
    whole_number,
)
from pcnclaws.commands.outputs import TRAJECTORY, output_file, scene_files
from pcnclaws.commands.progress_bar import progress_bar
from pcnclaws.commands.runs import laws_for
from pcnclaws.commands.typed_configs import SimulateConfig
from pcnclaws.data.hdf5 import write_scenes
from pcnclaws.errors import SimulationDiverged, UserError
from pcnclaws.laws.materials import material_named
from pcnclaws.simulation.particle_spacing import particles_a_cell, warn_of_sparse_particles
from pcnclaws.simulation.recorded_runs import simulate_records
from pcnclaws.simulation.recording import FramePlan
from pcnclaws.simulation.records import SceneRecord
from pcnclaws.simulation.restart import with_exact_masses
from pcnclaws.simulation.scenes import SceneStart
from pcnclaws.simulation.time_step import stability_of

log = logging.getLogger(__name__)


def simulate(config: SimulateConfig) -> None:
    """Writes the trajectory of the configured scene to `output`, and a picture of it beside it."""
    output = output_file(config.output, scene_files(config.scene), *TRAJECTORY)
    use_processor(config)
    start = start_from(config)
    record = _trajectory(config, start)
    # the picture first: a run that fails leaves no trajectory file
    picture = _picture(record, output) if config.picture else None
    write_scenes(output, [record])
    print(_summary(record, particles_a_cell(start), output))
    if picture:
        print(f"wrote {picture}")


def _picture(record: SceneRecord, output: Path) -> Path:
    from pcnclaws.rendering.pictures import picture_path, trajectory_picture  # loads matplotlib

    return trajectory_picture(record, picture_path(output))


def _trajectory(config: SimulateConfig, start: SceneStart) -> SceneRecord:
    stability = stability_of(start)
    stability.check()
    steps, every = (
        whole_number(config.simulation.steps, "simulation.steps"),
        whole_number(config.simulation.every, "simulation.every"),
    )
    if every > steps:
        raise UserError(f"simulation.every={every} keeps no frame; accepted: 1 to simulation.steps={steps}")
    keyframe_every = whole_number(config.keyframe_every, "keyframe_every", least=0)
    if keyframe_every > steps:
        raise UserError(f"keyframe_every={keyframe_every} keeps the start alone; accepted: 0 to {steps}")
    if steps % every:
        log.warning("simulation.every=%d: the last %d of %d steps are in no frame", every, steps % every, steps)
    laws = laws_for(config.law, material_named(config.material.name), [start.parameters])
    plan, execution = FramePlan(steps, every, keyframe_every, velocities=True), execution_from(config)
    warn_of_sparse_particles([start])
    with progress_bar("simulating", steps) as advance:
        try:
            record = simulate_records([start], laws, plan, replace(execution, progress=advance))[0]
            return with_exact_masses(record, start)
        except SimulationDiverged as error:
            raise SimulationDiverged(f"{error}; {stability.advice(error)}") from error


def _summary(record: SceneRecord, per_cell: float, output: Path) -> str:
    frames, count, _ = record.position.shape
    return (
        f"wrote {output}: scene '{record.name}' of {record.material}, {count} particles, {per_cell:.2g} a cell, "
        f"{frames} frames, {record.time[-1] - record.time[0]:.4g} s"
    )
