"""27 particles that fall, for tests of many steps."""

from bodies import analytic_simulator, lattice, one_scene, per_particle, seeded, spinning, uniform

from pcnclaws.laws.materials import MATERIALS
from pcnclaws.mpm.settings import SimulationSettings
from pcnclaws.mpm.state import ParticleState, Scenes
from pcnclaws.simulation.rollout import Step

PARTICLES = 27


def small_body(height: float = 0.3, velocity: tuple[float, float, float] = (0.2, -1.0, 0.0)) -> ParticleState:
    position = lattice((3, 3, 3), (0.15, 0.15, 0.15), (0.5, height, 0.5)) + 0.005 * uniform(seeded(0), 3, PARTICLES)
    return ParticleState.at_rest_shape(position, spinning(position, velocity, (0.0, 0.0, 5.0)))


def small_scene() -> Scenes:
    return one_scene(PARTICLES, 0.15**3 / PARTICLES)


def step_of(material: str, scenes: Scenes, time_step: float = 5e-4, **values: float) -> Step:
    parameters = per_particle(MATERIALS[material].defaults | values, len(scenes.mass))
    return analytic_simulator(material, SimulationSettings(time_step)).step_function(scenes, parameters)
