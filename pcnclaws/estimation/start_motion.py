"""Initial guess of an unknown start velocity and spin, from the first frames: a body in flight is nearly rigid."""

import numpy as np
import torch
from jaxtyping import Float

from pcnclaws.data.observation import Observation, ObservedPoints
from pcnclaws.estimation.comparison import SurfaceComparison
from pcnclaws.estimation.unknowns import Unknowns

# Frames of this long after the start are taken [s]; the first one that is later, where there is none.
FLIGHT = 0.02
# Points are laid on the surface so often at most, until no speed changes by more than this [m/s, rad/s].
LAID, SAME_SPEED = 30, 1e-4


def with_first_motion(
    observation: Observation, unknowns: Unknowns, values: Float[np.ndarray, " unknowns"]
) -> Float[np.ndarray, " unknowns"]:
    """The numbers with start velocities and spins fitted to x = x_0 + t v + t spin x (x_0 - centre) + g t^2 / 2."""
    values, sought = values.copy(), unknowns.motion
    if sought and observation.points is not None:
        values[sought] = _first_motion_of_points(observation, observation.points, unknowns)
        return values
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


def _first_motion_of_points(
    observation: Observation, points: ObservedPoints, unknowns: Unknowns
) -> Float[np.ndarray, " motion"]:
    """As with_first_motion, by iterated closest places of the surface.

    source  Chen and Medioni 1992, "Object modelling by registration of multiple range images"
    """
    after = observation.time[observation.time > 0.0]
    kept = (observation.time > 0.0) & (observation.time <= max(float(after[0]), FLIGHT))
    time, comparison = observation.time[kept][:, None, None], SurfaceComparison(points.of_frames(kept))
    gravity = np.broadcast_to(np.array(observation.settings.gravity), observation.position.shape)
    fallen = 0.5 * time**2 * _of_markers(observation, gravity)
    rates = [time * _of_markers(observation, _rigid_velocity(observation, unknowns, k)) for k in unknowns.motion]
    found = np.zeros(len(rates))
    for _ in range(LAID):
        motion = observation.places + fallen + sum(value * rate for value, rate in zip(found, rates, strict=True))
        assignment = comparison.assigned(_vectors(motion))
        rows = torch.stack([assignment.change(_vectors(rate)) for rate in rates], dim=1).numpy()
        change = np.linalg.lstsq(rows, -assignment.residual(_vectors(motion)).numpy(), rcond=1e-9)[0]
        found += change
        if np.abs(change).max() < SAME_SPEED:
            break
    return found


def _vectors(field: Float[np.ndarray, "frames markers 3"]) -> torch.Tensor:
    return torch.from_numpy(np.ascontiguousarray(np.moveaxis(field, 2, 1)))


def _of_markers(observation: Observation, field: Float[np.ndarray, "particles 3"]) -> Float[np.ndarray, "markers 3"]:
    """Vectors of the particles as those of the markers that follow them."""
    return np.einsum("mk,mkc->mc", observation.weight, field[observation.particle])


def _rigid_velocity(observation: Observation, unknowns: Unknowns, k: int) -> Float[np.ndarray, "particles 3"]:
    """Velocities of the particles for a unit of an unknown."""
    unknown = unknowns.sought[k]
    share = unknown.component.share if unknown.component else np.ones(len(observation.position))
    return share[:, None] * unknown.rigid_velocity(observation.position, observation.position)


def _motion(
    observation: Observation, unknowns: Unknowns, k: int, markers: Float[np.ndarray, "markers 3"]
) -> Float[np.ndarray, "markers 3"]:
    """Velocities of the markers for a unit of an unknown."""
    unknown = unknowns.sought[k]
    share = unknown.component.share if unknown.component else np.ones(len(observation.position))
    mine = np.einsum("mk,mk->m", observation.weight, share[observation.particle])
    return mine[:, None] * unknown.rigid_velocity(markers, observation.position)
