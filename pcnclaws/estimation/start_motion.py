"""Initial guess of an unknown start velocity and spin, from the first frames: a body in flight is nearly rigid."""

import numpy as np
from jaxtyping import Float

from pcnclaws.data.observation import Observation
from pcnclaws.estimation.unknowns import Unknowns

# Frames of this long after the start are taken [s]; the first one that is later, where there is none.
FLIGHT = 0.02


def with_first_motion(
    observation: Observation, unknowns: Unknowns, values: Float[np.ndarray, " unknowns"]
) -> Float[np.ndarray, " unknowns"]:
    """The numbers with start velocities and spins fitted to x = x_0 + t v + t spin x (x_0 - centre) + g t^2 / 2."""
    values, sought = values.copy(), unknowns.motion
    later = np.flatnonzero((observation.time > 0.0) & observation.seen.any(1))
    if not sought or not len(later):
        return values
    frames = later[: max(int(np.searchsorted(observation.time[later], FLIGHT)), 1)]
    rows, wanted = [], []
    markers = np.einsum("mk,mkc->mc", observation.weight, observation.position[observation.particle])
    for frame in frames.tolist():
        time, seen = float(observation.time[frame]), observation.seen[frame]
        fallen = markers + 0.5 * time**2 * np.array(observation.settings.gravity)
        wanted.append((observation.target[frame] - fallen)[seen].ravel())
        rows.append(np.stack([time * _motion(observation, unknowns, k, markers)[seen].ravel() for k in sought], axis=1))
    values[sought] = np.linalg.lstsq(np.concatenate(rows), np.concatenate(wanted), rcond=1e-9)[0]
    return values


def _motion(
    observation: Observation, unknowns: Unknowns, k: int, markers: Float[np.ndarray, "markers 3"]
) -> Float[np.ndarray, "markers 3"]:
    """Velocities of the markers for a unit of an unknown."""
    unknown = unknowns.sought[k]
    share = unknown.component.share if unknown.component else np.ones(len(observation.position))
    mine = np.einsum("mk,mk->m", observation.weight, share[observation.particle])
    return mine[:, None] * unknown.rigid_velocity(markers, observation.position)
