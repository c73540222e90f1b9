"""Energy of a body that is dropped: all that is there, all that has left, and by which way."""

from functools import cache
from typing import Any, NamedTuple

import numpy as np
import torch

import pcnclaws as pc
from benchmarks.verification.case import Case, Curve, Line, Outcome, Table, violation
from benchmarks.verification.independent_step import Grid, Particles, step
from benchmarks.verification.motion_scenes import affine_of, array, deformation_of

GRAVITY, SPACING, TIME_STEP, STEPS = -9.8, 0.05, 1e-4, 1200
PARAMETERS: dict[str, Any] = {"youngs_modulus": 4e5, "poissons_ratio": 0.3, "yield_stress": 4e3}


class Budget(NamedTuple):
    """Time [s], energies that are there and that have left since the start [J], each (frames,).

    mismatch  largest difference of the velocities of the independent step [m/s]
    """

    time: np.ndarray
    there: dict[str, np.ndarray]
    left: dict[str, np.ndarray]
    mismatch: float


@cache
def budget() -> Budget:
    """A cube of plasticine that hits the floor with 2 m/s, step by step."""
    body = pc.Body.cube(side=0.2, centre=(0.5, 0.28, 0.5), particles_per_edge=6)
    law = pc.analytic_law("plasticine")
    settings = pc.Settings(time_step=TIME_STEP, grid_spacing=SPACING)
    scene = pc.Scene(body, law, velocity=(0.0, -2.0, 0.0), settings=settings, **PARAMETERS)
    motion = scene.simulate(STEPS, 1, dtype=torch.float64, deformation=True)
    deformation, affines = deformation_of(motion), affine_of(motion)
    tau = law.stress(deformation, youngs_modulus=4e5, poissons_ratio=0.3)
    stress = array(tau)
    volume = float(body.volume[0])
    positions, velocities = array(motion.position), array(motion.velocity)
    particles = [
        Particles(position, velocity, affine, 1000.0 * volume, volume)
        for position, velocity, affine in zip(positions, velocities, affines, strict=True)
    ]
    grid = Grid(SPACING, TIME_STEP, GRAVITY, 0.1)
    steps = [step(one, acting, grid) for one, acting in zip(particles[:-1], stress[:-1], strict=True)]
    mismatch = max(
        float(np.abs(one.particles.velocity - velocity).max())
        for one, velocity in zip(steps, velocities[1:], strict=True)
    )
    rate = torch.from_numpy(affines[1:])
    trial = (torch.eye(3) + TIME_STEP * rate) @ deformation[:-1]
    # by the trapezoidal rule: forces are those of the stress at the start of a step alone
    flowed = (0.5 * (tau[1:] + tau[:-1]) * (_hencky(trial) - _hencky(deformation[1:]))).sum((1, 2, 3))
    explicit = -0.5 * TIME_STEP * ((tau[1:] - tau[:-1]) * rate).sum((1, 2, 3))
    there = {
        "kinetic": np.array([one.kinetic_energy(SPACING) for one in particles]),
        "elastic": array(_energy(deformation).sum(1)) * volume,
        "potential": -1000.0 * volume * GRAVITY * (positions[:, :, 1] - positions[0, :, 1]).sum(1),
    }
    left = {
        "plastic flow": _summed(array(flowed) * volume),
        "floor": _summed(np.array([one.floor for one in steps])),
        "transfers": _summed(np.array([one.transfers for one in steps])),
        "time stepping": _summed(np.array([one.stepping for one in steps]) + array(explicit) * volume),
    }
    return Budget(array(motion.time), there, left, mismatch)


def _hencky(deformation: torch.Tensor) -> torch.Tensor:
    """1/2 log(F F^T)."""
    values, vectors = torch.linalg.eigh(deformation @ deformation.mT)
    return vectors @ torch.diag_embed(0.5 * values.log()) @ vectors.mT


def _energy(deformation: torch.Tensor) -> torch.Tensor:
    """mu |h|^2 + lambda/2 tr(h)^2 [J/m^3]."""
    h = 0.5 * torch.linalg.eigvalsh(deformation @ deformation.mT).log()
    mu, lam = 4e5 / 2.6, 4e5 * 0.3 / (1.3 * 0.4)
    return mu * h.square().sum(-1) + 0.5 * lam * h.sum(-1).square()


def _summed(each: np.ndarray) -> np.ndarray:
    return np.concatenate([[0.0], np.cumsum(each)])


def balance() -> Outcome:
    """Largest change of the sum of all energies relative to the start; a table of the last frame."""
    found = budget()
    whole = float(sum(float(one[0]) for one in found.there.values()))
    total = np.sum([*found.there.values(), *found.left.values()], axis=0) / whole
    rows = [[name, f"{one[-1] / whole:+.4f}"] for name, one in (found.there | found.left).items()]
    lines = [Line(name, found.time, one / whole, []) for name, one in (found.there | found.left).items()]
    lines.append(Line("sum", found.time, total, np.ones_like(total)))
    curve = Curve("time [s]", "energy / start [-]", lines)
    table = Table(["", "after 0.12 s, of the energy at the start"], rows)
    return violation(float(np.abs(total - 1.0).max()), curve=curve, table=table)


def agreement() -> Outcome:
    """Largest difference of a velocity after a step from that of the independent step, relative to 2 m/s."""
    return violation(budget().mismatch / 2.0)


CASES = [
    Case(
        "energy_of_a_drop",
        "motion",
        "Kinetic, elastic and potential energy of a cube of plasticine that hits the floor, and what plastic flow, the "
        "floor, the transfers and the time stepping took, have one sum.",
        "conservation; losses by an independent step in NumPy",
        1e-3,
        balance,
        slow=True,
    ),
    Case(
        "independent_step",
        "motion",
        "Each of its 1200 steps is the one that docs/conventions.md describes, as an independent program takes it.",
        "benchmarks/verification/independent_step.py",
        1e-10,
        agreement,
        slow=True,
    ),
]
