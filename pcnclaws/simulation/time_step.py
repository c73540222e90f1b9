"""Stability of time steps: the CFL number of a scene, its measured limit, and the steps that it allows."""

import json
import logging
import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import cache, cached_property
from pathlib import Path

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor

from pcnclaws.errors import ParticleEscaped, SimulationDiverged, UserError
from pcnclaws.laws.materials import MATERIALS, Material, material_named
from pcnclaws.laws.parameters import compression_wave_speed
from pcnclaws.mpm.diagnostics import cfl_number, fall_speed
from pcnclaws.mpm.settings import SimulationSettings
from pcnclaws.simulation.collider_distance import collider_speed, fall_to_colliders
from pcnclaws.simulation.scenes import SceneStart

log = logging.getLogger(__name__)

COMFORTABLE_CFL = 0.4
# Largest CFL numbers at which falling and spinning bodies stay finite and gain no energy, by material and Poisson's
# ratio. Measured by: python -m benchmarks problem=stability problem.limits=pcnclaws/simulation/stable_cfl.json
STABLE_CFL_FILE = Path(__file__).with_name("stable_cfl.json")


def largest_speed(
    position: Float[np.ndarray, "particles 3"],
    velocity: Float[np.ndarray, "particles 3"],
    settings: SimulationSettings,
) -> float:
    """A bound of the speed before contact [m/s]: the fastest particle after the longest fall, or that of a collider.

    position  [m], (particles, 3)
    velocity  [m/s], (particles, 3)
    """
    start, gravity = float(np.linalg.norm(velocity, axis=1).max()), settings.gravity
    pushed = collider_speed(settings, position)
    strength = math.hypot(*gravity)
    if strength == 0.0:
        return max(start, pushed)
    # a body falls until its foremost particle meets the first wall in the direction of gravity, or a collider
    low, high = settings.within(settings.wall_distance)
    to_wall = np.where(np.asarray(gravity) < 0.0, position - low, high - position)
    along = [to_wall[:, axis].min() * strength / abs(g) for axis, g in enumerate(gravity) if g != 0.0]
    height = min(float(min(along)), fall_to_colliders(position, settings))
    # what falls on nothing is not met at any speed
    return max(fall_speed(start, max(height, 0.0), strength) if math.isfinite(height) else start, pushed)


def stable_cfl(material: str, poissons_ratio: float | None) -> float:
    """The CFL number [-] up to which simulations of a material are stable, from the measured table.

    Between the measured Poisson's ratios it goes linearly, beyond them it stays. A material that was not measured gets
    the smallest number of all that were, and so does None, a law without Poisson's ratio, of all of its ratios.
    """
    table = _stable_cfl_table()
    known = [table[material]] if material in table else list(table.values())
    if poissons_ratio is None:
        return min(min(limits["cfl"]) for limits in known)
    return min(float(np.interp(poissons_ratio, limits["poissons_ratio"], limits["cfl"])) for limits in known)


@dataclass(frozen=True)
class Stability:
    """Whether the time step of a scene is stable, and which ones are.

    settings    of the simulation, with the smallest density of its particles: waves are the fastest there
    parameters  physical parameters by name, those of the least stable particle
    speed       a bound of the speed before contact [m/s]
    material    its name
    known       the material itself, None for one that is not registered
    """

    settings: SimulationSettings
    parameters: Mapping[str, float]
    speed: float
    material: str
    known: Material | None = None

    @property
    def cfl(self) -> float:
        """CFL number dt (c + |v|) / dx [-]; with viscosity sqrt(CFL^2 + 2 nu dt / dx^2).

        A vibration x'' = -omega^2 x - d x' is stable in symplectic Euler for (omega dt)^2 + 2 d dt <= 4. With
        omega = c k and d = nu k^2 of a wave of number k, viscosity counts as so much more speed.
        nu  longitudinal viscosity over density [m^2/s], 4/3 eta/rho of a Newtonian law
        """
        settings = self.settings
        of_waves = cfl_number(settings.time_step, settings.grid_spacing, self._wave_speed, self.speed)
        if self._viscosity == 0.0:
            return of_waves
        return math.sqrt(of_waves**2 + 2.0 * self._viscosity * settings.time_step / settings.grid_spacing**2)

    @property
    def stable_cfl(self) -> float:
        """The CFL number [-] up to which such simulations were stable."""
        return stable_cfl(self.material, self.parameters.get("poissons_ratio"))

    @property
    def is_stable(self) -> bool:
        """Whether simulations with this time step were stable."""
        return self.cfl <= self.stable_cfl

    @property
    def automatic_time_step(self) -> float:
        """The time step [s] of CFL number 0.4, rounded down to three digits."""
        if self._viscosity > 0.0:
            return _rounded_down(self._time_step_of(COMFORTABLE_CFL))
        return _rounded_down(self.settings.time_step * COMFORTABLE_CFL / self.cfl)

    @property
    def longest_time_step(self) -> float:
        """The longest stable time step [s], rounded down to three digits."""
        return _rounded_down(self._time_step_of(self.stable_cfl))

    @property
    def limit(self) -> str:
        """In words: the longest time step of this scene, and the stiffest material of this time step."""
        if "youngs_modulus" not in self.parameters or self._viscosity > 0.0:
            return f"at most {self.longest_time_step:.3g} s at {self.speed:.3g} m/s"
        modulus = self.parameters["youngs_modulus"]
        accepted = f"at most {self.longest_time_step:.3g} s for youngs_modulus={modulus:g} at {self.speed:.3g} m/s"
        # E grows with the square of the wave speed
        room = self.stable_cfl * self.settings.grid_spacing / self.settings.time_step - self.speed
        if room <= 0.0:
            return accepted
        stiffest = _rounded_down(modulus * (room / self._wave_speed) ** 2)
        return f"{accepted}, or youngs_modulus at most {stiffest:.3g} Pa for this step"

    def check(self) -> None:
        """Refuses a time step above the stability boundary with a UserError, warns in one line above CFL number 0.4."""
        if not self.is_stable:
            raise UserError(f"simulation.time_step={self.settings.time_step:g} is unstable; accepted: {self.limit}")
        if self.cfl > COMFORTABLE_CFL:
            log.warning(
                f"simulation.time_step={self.settings.time_step:g} has the CFL number {self.cfl:.2f}: above "
                f"{self.stable_cfl:.2f} such bodies diverged; simulation.time_step=auto stays at {COMFORTABLE_CFL} "
                f"with {self.automatic_time_step:g} s"
            )

    def advice(self, error: SimulationDiverged) -> str:
        """In words, what to change after a divergence: the walls that a particle was pressed through, the step, or
        what crushes the body."""
        settings = self.settings
        if isinstance(error, ParticleEscaped) and not settings.walls_hold:
            return (
                f"wall_distance={settings.wall_distance:g} does not hold what is pressed against it; "
                f"from {settings.grid_spacing:.6g} m, a cell of the grid, it does"
            )
        step = f"time_step={settings.time_step:g}, stable: {self.limit}"
        if not self.is_stable:
            return step
        return (
            f"{step}; a shorter one hardly helps a body that is crushed or starts far deformed: it moves at up to "
            f"{self.speed:.3g} m/s with waves of {self._wave_speed:.3g} m/s; slower or stiffer ones hold"
        )

    def _time_step_of(self, cfl: float) -> float:
        """The time step of a CFL number [s]."""
        spacing, speed = self.settings.grid_spacing, self._wave_speed + self.speed
        if self._viscosity == 0.0:
            return cfl * spacing / speed
        half = self._viscosity / spacing
        return spacing * cfl**2 / (half + math.hypot(half, speed * cfl))

    @cached_property
    def _viscosity(self) -> float:
        """Longitudinal viscosity over density [m^2/s], 0 without a viscous law."""
        if self.known is None or self.known.viscosity is None:
            return 0.0
        return longitudinal_viscosity(self.known, self.parameters) / self.settings.density

    @cached_property
    def _wave_speed(self) -> float:
        parameters, density = self.parameters, self.settings.density
        if {"youngs_modulus", "poissons_ratio"} <= set(parameters):
            return compression_wave_speed(parameters["youngs_modulus"], parameters["poissons_ratio"], density)
        known = self.known or material_named(self.material)
        return math.sqrt(max(p_wave_modulus(known, parameters), 0.0) / density)


def stability_of(scene: SceneStart, material: Material | None = None) -> Stability:
    """The stability of the time step of a scene: that of its least stable particle.

    material  of the scene, where it is not a registered one
    """
    settings = scene.lightest
    speed = largest_speed(scene.position, scene.velocity, settings)
    known = material or MATERIALS.get(scene.material)
    one = Stability(settings, scene.parameters, speed, scene.material, known)
    if not scene.varying:
        return one
    values = scene.of_particles()
    moduli = [name for name in ("youngs_modulus", "poissons_ratio") if name in values]
    names = moduli if moduli and not (known and known.viscosity) else list(values)
    kinds = np.unique(np.stack([values[name] for name in names]), axis=1)
    each = [
        replace(one, parameters={**scene.parameters, **dict(zip(names, kind, strict=True))})
        for kind in zip(*kinds.tolist(), strict=True)
    ]
    return max(each, key=lambda kind: kind.cfl / kind.stable_cfl)


def p_wave_modulus(material: Material, parameters: Mapping[str, float]) -> float:
    """The stiffness of the analytic law of a material against compression along one axis, at rest [Pa]."""
    return _slope_along_an_axis(material.elasticity().kirchhoff_stress, torch.eye(3, dtype=torch.float64), parameters)


def longitudinal_viscosity(material: Material, parameters: Mapping[str, float]) -> float:
    """The resistance of the viscous law of a material to the rate of compression along one axis, at rest [Pa s]."""
    law, still = material.viscosity().viscous_stress, torch.zeros(3, 3, dtype=torch.float64)
    return _slope_along_an_axis(law, still, parameters)


def _slope_along_an_axis(
    law: Callable[[Tensor, dict[str, Tensor]], Tensor], at: Tensor, parameters: Mapping[str, float]
) -> float:
    """The derivative of a stress along an axis with respect to its argument along the same."""
    values = {name: torch.tensor([value], dtype=torch.float64) for name, value in parameters.items()}
    given = at[:, :, None].requires_grad_()
    with torch.enable_grad():
        (slope,) = torch.autograd.grad(law(given, values)[0, 0].sum(), given)
    return float(slope[0, 0])


def _rounded_down(value: float) -> float:
    """A positive number in three digits, not above it."""
    unit = 10.0 ** (math.floor(math.log10(value)) - 2)
    return float(f"{math.floor(value / unit) * unit:.3g}")


@cache
def _stable_cfl_table() -> dict[str, dict[str, list[float]]]:
    """By material: Poisson's ratios, increasing, and the limit at each."""
    return json.loads(STABLE_CFL_FILE.read_text(encoding="utf-8"))["limits"]
