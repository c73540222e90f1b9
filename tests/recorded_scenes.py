"""Short recorded scenes of a small cube for the tests of evaluation and rendering."""

from dataclasses import replace

import numpy as np
import torch

from pcnclaws.laws.analytic import analytic_laws
from pcnclaws.laws.elasticity import StVKHencky
from pcnclaws.laws.materials import MATERIALS
from pcnclaws.mpm.settings import SimulationSettings
from pcnclaws.simulation.execution import Execution
from pcnclaws.simulation.law_simulator import LawSimulator
from pcnclaws.simulation.recorded_runs import simulate_records
from pcnclaws.simulation.recording import FramePlan
from pcnclaws.simulation.records import SceneRecord
from pcnclaws.simulation.scenes import SceneStart

SAND = {"youngs_modulus": 3e5, "poissons_ratio": 0.2, "friction_angle": 30.0}
ELASTIC = {"youngs_modulus": 1e5, "poissons_ratio": 0.3}


def small_cube(
    name: str = "cube",
    material: str = "sand",
    velocity: tuple[float, float, float] = (0.5, -2.0, 0.0),
    settings: SimulationSettings | None = None,
) -> SceneStart:
    """A cube of 64 particles just above the floor."""
    edge = np.linspace(-0.1, 0.1, 4)
    position = np.stack(np.meshgrid(edge, edge, edge, indexing="ij"), axis=-1).reshape(-1, 3)
    position += np.array([0.5, 0.24, 0.5])
    return SceneStart(
        name,
        material,
        settings or SimulationSettings(),
        SAND if material == "sand" else ELASTIC,
        position,
        np.tile(velocity, (64, 1)),
        np.full(64, 0.2**3 / 64),
    )


def recorded(
    *starts: SceneStart, steps: int = 30, every: int = 5, keyframe_every: int = 10, dtype: torch.dtype = torch.float32
) -> list[SceneRecord]:
    """The true motion of the scenes."""
    laws = analytic_laws(MATERIALS[starts[0].material])
    return simulate_records(starts, laws, FramePlan(steps, every, keyframe_every), Execution(dtype))


class SofterHencky(StVKHencky):
    """The law of sand with nine tenths of the stress."""

    def kirchhoff_stress(self, deformation, parameters):
        return 0.9 * super().kirchhoff_stress(deformation, parameters)


def softer_sand() -> LawSimulator:
    return LawSimulator(analytic_laws(MATERIALS["sand"])._replace(elasticity=SofterHencky()))


def moved(record: SceneRecord, by: float) -> SceneRecord:
    """The record with every position after the first frame shifted along x by `by` [m]."""
    position = record.position.copy()
    position[1:, :, 0] += np.float32(by)
    return replace(record, position=position)
