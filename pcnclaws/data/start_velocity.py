"""Start velocities of recordings that do not say theirs: the first frames as the flight of a rigid body."""

import logging
from dataclasses import replace

import numpy as np

from pcnclaws.errors import UserError
from pcnclaws.geometry.velocity_gradients import spin_gradient
from pcnclaws.simulation.records import SceneRecord

log = logging.getLogger(__name__)

# Frames of this long after the start are taken [s]; the first one that is later, where there is none.
FLIGHT = 0.02


def with_start_velocity(record: SceneRecord) -> SceneRecord:
    """The record with the velocity and the spin that explain its first frames best, where it has no initial velocity.

        x(t) - x(0) - t (t + time_step) g / 2  =  t (v + spin x (x(0) - centre))

    the discrete fall of the simulation, by least squares over all particles that were seen. Right for bodies that begin
    in free flight; a line says what was found, and how far the first frames are from it.
    raises  UserError where there is no second frame to tell it from
    """
    if record.initial_velocity is not None:
        return record
    start, later = record.position[0].astype(np.float64), np.flatnonzero(record.time > record.time[0])
    if not len(later):
        raise UserError(f"{record.label}: has no initial_velocity, and no second frame to tell it from")
    duration = record.time[later] - record.time[0]
    later = later[: max(int(np.searchsorted(duration, FLIGHT)), 1)]
    centre, gravity = start.mean(0), np.array(record.settings.gravity)
    rows, wanted = [], []
    for frame in later.tolist():
        time, seen = float(record.time[frame] - record.time[0]), np.isfinite(record.position[frame]).all(1)
        fallen = start + 0.5 * time * (time + record.settings.time_step) * gravity
        unit = np.concatenate((np.eye(3)[:, None] + 0.0 * start, _turned(start - centre)))  # (6, particles, 3)
        rows.append(time * unit[:, seen].reshape(6, -1).T)
        wanted.append((record.position[frame] - fallen)[seen].ravel())
    matrix, right = np.concatenate(rows), np.concatenate(wanted)
    if not len(right):
        raise UserError(f"{record.label}: has no initial_velocity, and its second frame no particle to tell it from")
    found = np.linalg.lstsq(matrix, right, rcond=1e-9)[0]
    left = float(np.sqrt(np.mean(np.square(right - matrix @ found))))
    velocity, spin = found[:3], found[3:]
    log.warning(
        "%s: has no initial_velocity; its first %d frames are those of a flight with (%.3g, %.3g, %.3g) m/s and a spin "
        "of (%.3g, %.3g, %.3g) rad/s, to %.2g m",
        record.label,
        len(later),
        *velocity,
        *spin,
        left,
    )
    field = velocity + np.cross(spin, start - centre)
    gradient = np.broadcast_to(spin_gradient(spin.tolist()), (len(start), 3, 3))
    kind = record.position.dtype
    return replace(record, initial_velocity=field.astype(kind), initial_affine=gradient.astype(kind))


def _turned(arm: np.ndarray) -> np.ndarray:
    """Velocities of points at these arms [m] for a unit spin about each axis, (3, particles, 3)."""
    return np.stack([np.cross(axis, arm) for axis in np.eye(3)])
