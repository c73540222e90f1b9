"""Unlabelled points on a small cube that hits the floor, as a camera above one of its corners sees them."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import torch
from observed_bodies import start

from pcnclaws.data.observation import Observation
from pcnclaws.data.point_frames import PointFrames, write_point_frames
from pcnclaws.data.point_observation import from_points, surface_vertices
from pcnclaws.estimation.problem import EstimationProblem
from pcnclaws.estimation.unknowns import components_of, make_unknowns
from pcnclaws.geometry.particle_surface import particle_surface
from pcnclaws.geometry.shapes import PointCloud
from pcnclaws.geometry.surface_views import seen_points
from pcnclaws.laws.analytic import analytic_laws
from pcnclaws.laws.materials import MATERIALS
from pcnclaws.simulation.execution import Execution
from pcnclaws.simulation.particle_spacing import particle_spacing
from pcnclaws.simulation.recorded_runs import simulate_records
from pcnclaws.simulation.recording import FramePlan
from pcnclaws.simulation.records import SceneRecord

CAMERA = (1.0, 1.0, 1.0)
STEPS = 80


def motion(material: str = "elasticity", every: int = 8, dtype: torch.dtype = torch.float32) -> SceneRecord:
    laws = analytic_laws(MATERIALS[material])
    return simulate_records([start(material)], laws, FramePlan(STEPS, every), Execution(dtype))[0]


def seen(
    record: SceneRecord,
    count: int = 80,
    noise: float = 0.0,
    camera: Sequence[float] | None = CAMERA,
    seed: int = 0,
    offset: float = 0.0,
) -> PointFrames:
    """Points of every frame; their surface is farther out than the body's by `offset` [m]."""
    chance = np.random.default_rng(seed)
    position, volume = record.position.astype(np.float64), record.volume.astype(np.float64)
    surface = particle_surface(position[0], volume, particle_spacing(position[0], volume))
    vertices = surface_vertices(surface._replace(offset=surface.offset + offset), position)
    towards = None if camera is None else np.array(camera)
    counts = chance.integers(count // 2, count, len(vertices), endpoint=True).tolist()
    found = [
        seen_points(one, surface.faces, number, towards, chance) for one, number in zip(vertices, counts, strict=True)
    ]
    place = np.concatenate(found)
    place += noise * chance.standard_normal(place.shape)
    return PointFrames(record.time - record.time[0], place, np.repeat(np.arange(len(counts)), counts))


def body_of(record: SceneRecord) -> PointCloud:
    start_velocity = record.initial_velocity
    velocity = np.zeros_like(record.position[0]) if start_velocity is None else start_velocity
    position, volume = record.position[0].astype(np.float64), record.volume.astype(np.float64)
    return PointCloud(position, velocity.astype(np.float64), volume)


def observation_of(record: SceneRecord, points: PointFrames, path: Path, velocity_known: bool = True) -> Observation:
    """What from_points makes of a file of the points."""
    write_point_frames(path, points)
    return from_points(path, record.material, record.settings, body_of(record), velocity_known=velocity_known)


def problem_of_points(
    observation: Observation, motion: bool = False, offset: bool = False, dtype: torch.dtype = torch.float32
) -> EstimationProblem:
    material = MATERIALS[observation.material]
    parts = components_of("uniform", observation.position, observation.spacing)
    unknowns = make_unknowns(
        material.parameter_names, {}, parts, parts, motion=motion, time_offset=False, surface_offset=offset
    )
    return EstimationProblem(analytic_laws(material), observation, unknowns, Execution(dtype))
