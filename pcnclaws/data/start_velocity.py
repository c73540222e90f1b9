"""Start velocities of recordings that do not say theirs: the first frames as the flight of a rigid body."""

import logging
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from pcnclaws.errors import UserError
from pcnclaws.geometry.velocity_gradients import spin_gradient
from pcnclaws.simulation.records import SceneRecord

log = logging.getLogger(__name__)

# Frames of this long after the start are taken at least [s]; the first one that is later, where there is none.
FLIGHT = 0.02
# More are taken, twice as many each time, as long as the flight explains them not worse than this, relative to the
# first ones, whose residual is the noise, and than this [m].
WORSE, ROUNDING = 1.05, 1e-7


class _Flight(NamedTuple):
    """Velocity [m/s], spin [rad/s] and residual [m] of a rigid body in free fall."""

    velocity: np.ndarray
    spin: np.ndarray
    residual: float


def with_start_velocity(record: SceneRecord) -> SceneRecord:
    """The record with the velocity and the spin that explain its first frames best, where it has no initial velocity.

        x(t) - x(0) - t (t + time_step) g / 2  =  t (v + spin x (x(0) - centre))

    the discrete fall of the simulation, by least squares over all particles that were seen, and over as many frames as
    are such a flight. Right for bodies that begin in free flight; a line says what was found, and how far the frames
    are from it.
    raises  UserError where there is no second frame to tell it from
    """
    if record.initial_velocity is not None:
        return record
    later = np.flatnonzero(record.time > record.time[0])
    if not len(later):
        raise UserError(f"{record.label}: has no initial_velocity, and no second frame to tell it from")
    count = max(int(np.searchsorted(record.time[later] - record.time[0], FLIGHT)), 1)
    flight = _fitted(record, later[:count])
    accepted = WORSE * flight.residual + ROUNDING
    while count < len(later) and (longer := _fitted(record, later[: 2 * count])).residual <= accepted:
        count, flight = min(2 * count, len(later)), longer
    log.warning(
        "%s: has no initial_velocity; its first %d frames are those of a flight with (%.3g, %.3g, %.3g) m/s and a spin "
        "of (%.3g, %.3g, %.3g) rad/s, to %.2g m",
        record.label,
        count,
        *flight.velocity,
        *flight.spin,
        flight.residual,
    )
    start, kind = record.position[0].astype(np.float64), record.position.dtype
    field = flight.velocity + np.cross(flight.spin, start - start.mean(0))
    gradient = np.broadcast_to(spin_gradient(flight.spin.tolist()), (len(start), 3, 3))
    return replace(record, initial_velocity=field.astype(kind), initial_affine=gradient.astype(kind))


def _fitted(record: SceneRecord, frames: np.ndarray) -> _Flight:
    """The flight that explains these frames best."""
    start, gravity = record.position[0].astype(np.float64), np.array(record.settings.gravity)
    unit = np.concatenate((np.eye(3)[:, None] + 0.0 * start, _turned(start - start.mean(0))))  # (6, particles, 3)
    rows, wanted = [], []
    for frame in frames.tolist():
        time, seen = float(record.time[frame] - record.time[0]), np.isfinite(record.position[frame]).all(1)
        fallen = start + 0.5 * time * (time + record.settings.time_step) * gravity
        rows.append(time * unit[:, seen].reshape(6, -1).T)
        wanted.append((record.position[frame] - fallen)[seen].ravel())
    matrix, right = np.concatenate(rows), np.concatenate(wanted)
    if not len(right):
        raise UserError(f"{record.label}: has no initial_velocity, and its second frame no particle to tell it from")
    found = np.linalg.lstsq(matrix, right, rcond=1e-9)[0]
    return _Flight(found[:3], found[3:], float(np.sqrt(np.mean(np.square(right - matrix @ found)))))


def _turned(arm: np.ndarray) -> np.ndarray:
    """Velocities of points at these arms [m] for a unit spin about each axis, (3, particles, 3)."""
    return np.stack([np.cross(axis, arm) for axis in np.eye(3)])
