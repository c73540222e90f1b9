"""Bodies as people drop them: a grain, a rod, a sheet, a cube. Their symmetry makes strains that are almost zero."""

import numpy as np
import pytest
import torch

from pcnclaws.compiled.backend import using_backend
from pcnclaws.compiled.build import find_compiler
from pcnclaws.compiled.isotropic_laws import fallbacks
from pcnclaws.laws.analytic import analytic_laws
from pcnclaws.laws.materials import material_named
from pcnclaws.mpm.settings import SimulationSettings
from pcnclaws.simulation.execution import Execution
from pcnclaws.simulation.recorded_runs import simulate_records
from pcnclaws.simulation.recording import FramePlan
from pcnclaws.simulation.scenes import SceneStart

pytestmark = pytest.mark.skipif(find_compiler() is None, reason="needs a C++ compiler")
HALF_CELL = 0.025
OFF_NODE = (0.513, 0.407, 0.489)
# particles along each axis, centre [m], spacing [m]
SCENES = {
    "grain on a node": ((1, 1, 1), (0.5, 0.4, 0.5), HALF_CELL),
    "grain off a node": ((1, 1, 1), OFF_NODE, HALF_CELL),
    "grain between nodes": ((1, 1, 1), (0.525, 0.425, 0.525), HALF_CELL),
    "two grains above each other": ((1, 2, 1), (0.5, 0.4, 0.5), HALF_CELL),
    "two grains beside each other": ((2, 1, 1), (0.5, 0.4, 0.5), HALF_CELL),
    "two grains off the nodes": ((2, 1, 1), OFF_NODE, HALF_CELL),
    "vertical rod": ((1, 12, 1), (0.5, 0.4, 0.5), HALF_CELL),
    "vertical rod off the nodes": ((1, 12, 1), OFF_NODE, HALF_CELL),
    "sparse vertical rod": ((1, 10, 1), (0.5, 0.4, 0.5), 0.0333),
    "thick rod": ((2, 12, 2), (0.5, 0.4, 0.5), HALF_CELL),
    "thicker rod": ((3, 12, 3), (0.5, 0.4, 0.5), HALF_CELL),
    "horizontal rod": ((12, 1, 1), (0.5, 0.4, 0.5), HALF_CELL),
    "vertical sheet": ((8, 8, 1), (0.5, 0.4, 0.5), HALF_CELL),
    "vertical sheet off the nodes": ((8, 8, 1), OFF_NODE, HALF_CELL),
    "horizontal sheet": ((8, 1, 8), (0.5, 0.4, 0.5), HALF_CELL),
    "cube of 3": ((3, 3, 3), (0.5, 0.4, 0.5), 2 * HALF_CELL),
    "cube of 5": ((5, 5, 5), (0.5, 0.4, 0.5), 2 * HALF_CELL),
    "cube of 9": ((9, 9, 9), (0.5, 0.45, 0.5), 2 * HALF_CELL),
    "cube of 11": ((11, 11, 11), (0.5, 0.45, 0.5), 2 * HALF_CELL),
}
# What single precision makes of the same motion in 500 steps [m].
TOLERANCES = {torch.float32: 5e-5, torch.float64: 1e-9}


@pytest.mark.parametrize("name", ["grain off a node", "vertical rod", "vertical sheet"])
def test_kernels_drop_sand_as_pytorch_does(name: str) -> None:
    _compare(name, "sand", torch.float32, 300)


@pytest.mark.slow
@pytest.mark.parametrize("dtype", [torch.float32, torch.float64])
@pytest.mark.parametrize("name", SCENES)
@pytest.mark.parametrize("material", ["sand", "plasticine", "elasticity"])
def test_kernels_drop_every_body_as_pytorch_does(material: str, name: str, dtype: torch.dtype) -> None:
    _compare(name, material, dtype, 500)


def _compare(name: str, material: str, dtype: torch.dtype, steps: int) -> None:
    start, laws, before = _start(name, material), analytic_laws(material_named(material)), fallbacks()
    found = simulate_records([start], laws, FramePlan(steps, 5, velocities=True), Execution(dtype=dtype))[0]
    assert fallbacks() == before  # no strain of these scenes is far from 0
    with using_backend("torch"):
        expected = simulate_records([start], laws, FramePlan(steps, 5, velocities=True), Execution(dtype=dtype))[0]
    assert np.abs(found.position - expected.position).max() < TOLERANCES[dtype]
    assert found.velocity is not None
    assert np.abs(found.velocity).max() < 5.0  # the fall of 0.5 m: 3.1 m/s


def _start(name: str, material: str) -> SceneStart:
    counts, centre, spacing = SCENES[name]
    axes = [
        (np.arange(count) - 0.5 * (count - 1)) * spacing + middle for count, middle in zip(counts, centre, strict=True)
    ]
    position = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3)
    volume, parameters = np.full(len(position), HALF_CELL**3), dict(material_named(material).defaults)
    return SceneStart(name, material, SimulationSettings(), parameters, position, np.zeros_like(position), volume)
