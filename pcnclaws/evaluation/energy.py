"""The energy of simulated bodies: what a stable run cannot gain, and how far off a predicted one is."""

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor

from pcnclaws.laws.base import Elasticity
from pcnclaws.mpm.state import ParticleState, Scenes
from pcnclaws.simulation.batch import batch_scenes
from pcnclaws.simulation.records import SceneRecord
from pcnclaws.simulation.scenes import restarted, start_of
from pcnclaws.tensors.tensor_types import Parameters, Scalars


def scene_energy(
    state: ParticleState, scenes: Scenes, parameters: Parameters, elasticity: Elasticity, spacing: float
) -> Tensor:
    """Kinetic and elastic energy of each scene [J], (scenes,), double precision.

    The kinetic energy includes that of the affine velocities, m dx^2 / 8 |C|^2.
    elasticity  a law that states its energy
    """
    doubled = {name: values.double() for name, values in parameters.items()}
    speeds = state.velocity.double().square().sum(0) + 0.25 * spacing**2 * state.affine.double().square().sum((0, 1))
    elastic = elasticity.energy_density(state.deformation.double(), doubled)
    return _by_scene(0.5 * scenes.mass.double() * speeds + scenes.volume.double() * elastic, scenes)


def potential_energy(state: ParticleState, scenes: Scenes, floor: float) -> Tensor:
    """Energy of gravity of each scene [J], (scenes,), zero at x = z = 0 at the height `floor` [m]."""
    position = state.position.double() - torch.tensor([0.0, floor, 0.0], device=state.position.device).double()[:, None]
    gravity = scenes.gravity.double()[:, scenes.scene_index]
    return _by_scene(-scenes.mass.double() * (gravity * position).sum(0), scenes)


def energy_error(true: SceneRecord, predicted: SceneRecord, elasticity: Elasticity) -> float | None:
    """Largest error of the total mechanical energy at the keyframes [-], relative to the liveliest true state.

        max |E - E_true| / max (kinetic + elastic energy of the true motion)

    E is kinetic, elastic and gravitational energy; the elastic one is the analytic law's at the elastic deformation
    gradient, whichever law the motion is of.
    elasticity  the analytic law
    returns     None where the true record has no keyframes after its start, or the two share none of them, or the law
                states no energy
    """
    if true.keyframes is None or predicted.keyframes is None or not elasticity.has_energy:
        return None
    shared, *rows = np.intersect1d(true.keyframes.step, predicted.keyframes.step, return_indices=True)
    if shared.max(initial=0) == 0:
        return None
    (lively, total), (_, predicted_total) = (
        _keyframe_energies(record, which, elasticity) for record, which in zip((true, predicted), rows, strict=True)
    )
    return float(np.abs(predicted_total - total).max() / lively.max()) if lively.max() > 0.0 else None


@torch.no_grad()
def _keyframe_energies(
    record: SceneRecord, which: np.ndarray, elasticity: Elasticity
) -> tuple[Float[np.ndarray, " keyframes"], Float[np.ndarray, " keyframes"]]:
    """Kinetic and elastic energy, and the total one [J], of some keyframes."""
    lively, total = [], []
    if record.keyframes is None:
        raise ValueError("a record without keyframes has no full state")
    start = start_of(record)
    for row in which:  # one at a time, which bounds the memory
        state = restarted(start, record.keyframes, int(row))
        batch = batch_scenes([state], torch.float64)
        internal = {name: torch.tensor(values, dtype=torch.float64) for name, values in state.internal.items()}
        fields, settings = (batch.state, batch.scenes), record.settings
        known = {**batch.parameters, **internal}
        lively.append(scene_energy(*fields, known, elasticity, settings.grid_spacing).item())
        total.append(lively[-1] + potential_energy(*fields, settings.floor).item())
    return np.array(lively), np.array(total)


def _by_scene(values: Scalars, scenes: Scenes) -> Tensor:
    return torch.zeros(scenes.scene_count, dtype=values.dtype, device=values.device).index_add(
        0, scenes.scene_index, values
    )
