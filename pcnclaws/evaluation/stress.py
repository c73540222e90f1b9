"""The stress error of a law at the recorded states of a scene."""

import copy
import math

import numpy as np
import torch
from jaxtyping import Float

from pcnclaws.laws.analytic import Laws
from pcnclaws.laws.base import Elasticity
from pcnclaws.metrics import relative_stress_error
from pcnclaws.simulation.records import Keyframes, SceneRecord
from pcnclaws.tensors.layout import matrices_first, matrices_last

# A particle acts on, and feels, the grid nodes up to this many cells away.
REACH = 1.5


def stress_error(record: SceneRecord, laws: Laws, analytic: Laws, dtype: torch.dtype = torch.float32) -> float | None:
    """Relative error [-] of the Kirchhoff stress of `laws` at the recorded keyframes after contact.

    Both laws see the recorded elastic deformation gradients, so the error is that of the elasticity alone, free
    of what the motion accumulates. It is sum |tau - tau_true| / sum |tau_true| over the particles of all keyframes
    from the first one on at which a particle feels a wall node: before it there is little stress to compare.
    dtype    of the stresses
    returns  None when the record has no keyframes after contact, or no stress at them
    """
    keyframes = _states_after_contact(record)
    if keyframes is None:
        return None
    # one keyframe at a time: a neural law needs far more memory than the states themselves
    rows = range(len(keyframes.step))
    stress, true_stress = (
        np.concatenate([_stress(keyframes.at(slice(row, row + 1)), record, elasticity, dtype) for row in rows])
        for elasticity in (copy.deepcopy(some.elasticity).to(dtype) for some in (laws, analytic))
    )
    error = relative_stress_error(stress, true_stress)
    return None if math.isnan(error) else error


def _states_after_contact(record: SceneRecord) -> Keyframes | None:
    keyframes = record.keyframes
    if keyframes is None:
        return None
    settings = record.settings
    low, high = settings.within(settings.wall_distance + REACH * settings.grid_spacing)
    touching = ((keyframes.position < low) | (keyframes.position > high)).any((1, 2))
    after = np.logical_or.accumulate(touching)
    return keyframes.at(np.flatnonzero(after)) if after.any() else None


@torch.no_grad()
def _stress(
    keyframe: Keyframes, record: SceneRecord, elasticity: Elasticity, dtype: torch.dtype
) -> Float[np.ndarray, "particles 3 3"]:
    """Kirchhoff stress [Pa] of one keyframe; the weights of the law, where it has any, are of the same type."""
    device = next(elasticity.parameters(), torch.zeros(())).device
    states = torch.tensor(matrices_first(keyframe.deformation[0]), dtype=dtype, device=device)
    known = {name: states.new_full((states.shape[2],), value) for name, value in record.parameters.items()}
    known |= {name: torch.tensor(one[0], dtype=dtype, device=device) for name, one in keyframe.internal.items()}
    return matrices_last(elasticity.kirchhoff_stress(states, known))
