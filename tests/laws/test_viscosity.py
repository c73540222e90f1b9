"""Viscous laws: a vibration that they damp, what they give, and the time steps that they allow."""

import math
from typing import Any

import numpy as np
import pytest
import torch
from bodies import seeded, uniform

import pcnclaws as pc
from pcnclaws.errors import SimulationDiverged, UserError
from pcnclaws.laws.elasticity import StVKHencky
from pcnclaws.laws.materials import Material
from pcnclaws.laws.viscosity import NewtonianViscosity
from pcnclaws.simulation.recorded_runs import simulate_records
from pcnclaws.simulation.recording import FramePlan

MODULUS, RATIO, DENSITY = 1e5, 0.25, 1000.0
DAMPED = Material(
    "damped",
    StVKHencky,
    None,
    {"youngs_modulus": (1e3, 2e5), "poissons_ratio": (0.1, 0.4), "viscosity": (0.0, 5e3)},
    viscous=NewtonianViscosity,
)
SPACING = 0.025


def _bar() -> tuple[pc.Body, np.ndarray]:
    """A bar of 1 m x 0.2 m x 0.2 m, and its slowest mode of vibration along its axis at the particles."""
    places = [(np.arange(count) + 0.5) * SPACING for count in (40, 8, 8)]
    position = np.stack(np.meshgrid(*places, indexing="ij"), -1).reshape(-1, 3)
    return pc.Body.points(position, np.full(len(position), SPACING**3)), np.cos(math.pi * position[:, 0])


def _settings(time_step: float | str) -> pc.Settings:
    return pc.Settings(domain=None, gravity=(0.0, 0.0, 0.0), grid_spacing=2.0 * SPACING, time_step=time_step)


def _decay(viscosity: float) -> float:
    """Rate of decay of the vibration of a free bar [1/s]."""
    body, mode = _bar()
    velocity = np.zeros((len(mode), 3))
    velocity[:, 0] = 0.05 * mode
    values: dict[str, Any] = {"youngs_modulus": MODULUS, "poissons_ratio": RATIO, "viscosity": viscosity}
    scene = pc.Scene(body, pc.analytic_law(DAMPED), velocity=velocity, settings=_settings(9e-4), **values)
    motion = scene.simulate(steps=300, every=2)
    omega = math.pi * math.sqrt(MODULUS / DENSITY)
    speed = motion.velocity[:, :, 0].numpy() @ mode
    way = (motion.position - motion.position[:1])[:, :, 0].numpy() @ mode
    return -np.polyfit(motion.time.numpy(), np.log(np.hypot(speed, omega * way)), 1)[0]


def test_a_bar_vibrates_as_a_kelvin_voigt_solid() -> None:
    """Its complex modulus is E* = 9 K mu* / (3 K + mu*), mu* = mu + i omega eta: the motion decays with Im(omega*)."""
    omega, viscosity = math.pi * math.sqrt(MODULUS / DENSITY), 120.0
    shear = MODULUS / (2.0 * (1.0 + RATIO)) + 1j * omega * viscosity
    bulk = MODULUS / (3.0 * (1.0 - 2.0 * RATIO))
    expected = omega * np.sqrt(9.0 * bulk * shear / (3.0 * bulk + shear) / MODULUS).imag
    # what the transfer to the grid and back damps by itself
    numerical = _decay(0.0)
    assert numerical < 0.02 * expected
    assert _decay(viscosity) - numerical == pytest.approx(expected, rel=0.03)


def test_the_stress_is_that_of_newton_and_none_in_a_rigid_motion() -> None:
    law = pc.analytic_law(DAMPED)
    gradient = uniform(seeded(1), 5, 3, 3)
    rate = 0.5 * (gradient + gradient.mT)
    trace = rate.diagonal(dim1=1, dim2=2).sum(1)[:, None, None]
    expected = 2.0 * 3.0 * (rate - trace / 3.0 * torch.eye(3, dtype=torch.float64))
    torch.testing.assert_close(law.viscous_stress(gradient, viscosity=3.0), expected)
    assert not law.viscous_stress(gradient - gradient.mT, viscosity=3.0).any()
    assert not pc.analytic_law("sand").viscous_stress(gradient).any()
    with pytest.raises(UserError, match=r"parameters.viscosity is missing"):
        law.viscous_stress(gradient)
    with pytest.raises(UserError, match="the velocity gradient is a tensor"):
        law.viscous_stress(gradient[0, 0], viscosity=3.0)


@pytest.mark.parametrize(("viscosity", "modulus"), [(2000.0, 1e3), (2000.0, 1e5), (100.0, 1e5)])
def test_the_longest_time_step_knows_the_viscosity(viscosity: float, modulus: float) -> None:
    """Random velocities die down at the limit, and blow up at four times it; longer steps are refused."""
    body, _ = _bar()
    velocity = uniform(seeded(2), len(body), 3)
    values: dict[str, Any] = {"youngs_modulus": modulus, "poissons_ratio": RATIO, "viscosity": viscosity}
    scene = pc.Scene(body, pc.analytic_law(DAMPED), velocity=velocity, settings=_settings("auto"), **values)
    assert scene.cfl == pytest.approx(0.4, rel=0.01)
    longest = scene.stable_time_step
    at_limit = scene.with_(settings=_settings(longest)).simulate(steps=100, every=100)
    assert float(at_limit.velocity[-1].norm()) < 0.2 * float(velocity.norm())
    beyond = scene.with_(settings=_settings(4.0 * longest))
    with pytest.raises(UserError, match="is unstable; accepted: at most"):
        beyond.simulate()
    with pytest.raises(SimulationDiverged):
        simulate_records([beyond._start], beyond.law.laws, FramePlan(20, 20))
