"""A standard linear solid of one's own: relaxation after a ramp of strain, and creep under a held stress."""

import numpy as np
import torch
from torch import Tensor

import pcnclaws as pc
from benchmarks.verification.case import Case, Curve, Line, Outcome, lines_of
from benchmarks.verification.element_paths import diagonal, driven
from benchmarks.verification.viscoelastic_laws import ZENER
from pcnclaws.compiled.backend import using_backend

# mu = 1e5 Pa, mu_1 = 2e5 Pa, t_r = 0.1 s.
MU, BRANCH, TIME = 1e5, 2e5, 0.1
PARAMETERS = {
    "youngs_modulus": 2.0 * MU * 1.3,
    "poissons_ratio": 0.3,
    "branch_modulus": BRANCH,
    "relaxation_time": TIME,
}
# Uniaxial, without a change of volume.
SHAPE = np.array([1.0, -0.5, -0.5])
STRAIN, RAMP, HELD = 0.05, 0.05, 0.5
STRESS, CREEP = 5e3, 1.0
# The end of the ramp is the end of a step.
RELAXATION_STEPS, CREEP_STEPS = 110, 100
SOURCE = "closed form, Zener 1948"


def relaxation() -> Outcome:
    """tau = 2 mu e + 2 mu_1 e' t_r (1 - e^(-t / t_r)) on the ramp, and what it has then decays by e^(-t / t_r)."""
    time = np.linspace(0.0, RAMP + HELD, RELAXATION_STEPS + 1)
    strain = STRAIN * np.minimum(time / RAMP, 1.0)
    with using_backend("torch"):
        ours = driven(pc.analytic_law(ZENER), strain[:, None] * SHAPE, PARAMETERS, time)[:, 0]
    loaded = np.minimum(time, RAMP)
    branch = STRAIN / RAMP * TIME * -np.expm1(-loaded / TIME) * np.exp(-(time - loaded) / TIME)
    line = Line("relaxation", time, ours, 2.0 * MU * strain + 2.0 * BRANCH * branch)
    return lines_of(Curve("time [s]", "axial deviatoric stress [Pa]", [line]), "Pa")


def creep() -> Outcome:
    """e = tau / (2 mu) (1 - mu_1 / (mu + mu_1) e^(-t / t_c)), t_c = t_r (mu + mu_1) / mu, from the first moment on."""
    time = np.linspace(0.0, CREEP, CREEP_STEPS + 1)
    slower = TIME * (MU + BRANCH) / MU
    theirs = STRESS / (2.0 * MU) * (1.0 - BRANCH / (MU + BRANCH) * np.exp(-time / slower))
    with using_backend("torch"):
        ours = _crept(pc.analytic_law(ZENER), time)
    line = Line("creep", time[1:], ours, theirs[1:])
    return lines_of(Curve("time [s]", "axial strain [-]", [line]))


def _crept(law: pc.ConstitutiveModel, time: np.ndarray) -> np.ndarray:
    """Axial strains at all times but the first; the stress is put on within a time that is too short to relax."""
    elastic: Tensor = torch.eye(3, dtype=torch.float64)
    internal: Tensor | None = None
    found = [0.0]
    for elapsed in [1e-9 * TIME, *np.diff(time)]:

        def answer(strain: float, dt: float = float(elapsed), start: Tensor = elastic, kept: Tensor | None = internal):
            trial = diagonal(*np.exp((strain - found[-1]) * SHAPE)) @ start
            return law.return_map(trial, internal=kept, dt=dt, **PARAMETERS)

        def excess(strain: float) -> float:
            f, kept = answer(strain)
            return float(law.stress(f, internal=kept, **PARAMETERS)[0, 0]) - STRESS

        # the stress is linear in the strain of a step
        at_left, at_right = excess(found[-1]), excess(found[-1] + 1e-3)
        strain = found[-1] - 1e-3 * at_left / (at_right - at_left)
        elastic, internal = answer(strain)
        found.append(strain)
    return np.array(found[2:])


CASES = [
    Case(
        "zener_ramp_hold",
        "laws",
        "A law of one's own, a spring beside a Maxwell branch, relaxes from a ramp of strain as its closed form says.",
        SOURCE,
        1e-9,
        relaxation,
    ),
    Case(
        "zener_creep",
        "laws",
        "The same law creeps under a held stress as its closed form says.",
        SOURCE,
        1e-4,
        creep,
    ),
]
