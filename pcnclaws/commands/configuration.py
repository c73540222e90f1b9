"""Objects of the package from typed options: each option is checked where its object is made."""

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np
import torch
from jaxtyping import Float

from pcnclaws.commands.surroundings import domain_of, grid_spacing_from, surroundings_from
from pcnclaws.commands.typed_configs import (
    CalibrateConfig,
    Computation,
    EstimateConfig,
    Number,
    ObservedSimulation,
    Scene,
    SimulateConfig,
    SimulatingCommand,
    Simulation,
)
from pcnclaws.compiled.backend import use_backend
from pcnclaws.data.observation import Observation
from pcnclaws.data.observation_files import from_record, from_table, observed_record
from pcnclaws.data.point_files import read_point_file
from pcnclaws.errors import UserError, unknown_name
from pcnclaws.geometry.shapes import PointCloud, mesh_particles, particles, spin_velocity
from pcnclaws.geometry.velocity_gradients import spin_gradient, velocity_gradients
from pcnclaws.laws.materials import Material, material_named
from pcnclaws.laws.parameters import validate_parameters
from pcnclaws.mpm.settings import SimulationSettings
from pcnclaws.simulation.execution import Execution
from pcnclaws.simulation.fast_paths import Skips
from pcnclaws.simulation.placement import require_inside, require_volume
from pcnclaws.simulation.scenes import SceneStart
from pcnclaws.simulation.time_step import stability_of

DEVICES = ("cpu", "cuda", "auto")
# What a body starts with as C: the gradient of its velocities, nothing, or (auto) the former but for a trajectory
# file, which says it itself.
AFFINES = ("auto", "velocity", "zero")
PRECISIONS = {"float32": torch.float32, "float64": torch.float64}


def parameters_from(options: Mapping[str, Number], material: Material) -> dict[str, float]:
    """The physical parameters of `parameters.*`, checked."""
    values = {name: float(value) for name, value in options.items()}
    validate_parameters(values, material.parameter_names)
    return values


def settings_from(
    simulation: Simulation, automatic: float | None = None, scene: Scene | None = None
) -> SimulationSettings:
    """The settings of `simulation.*`, whose walls hold.

    automatic  the time step [s] that simulation.time_step=auto stands for, None where it is not accepted
    scene      whose colliders and loads belong to them, None for neither
    """
    time_step = automatic if simulation.time_step == "auto" else simulation.time_step
    if time_step is None:
        raise UserError("simulation.time_step=auto is not accepted here; accepted: a positive finite number [s]")
    gravity = [float(component) for component in simulation.gravity]
    settings = SimulationSettings(
        time_step=float(time_step),
        grid_spacing=grid_spacing_from(simulation) or float(simulation.grid_spacing),
        wall_distance=float(simulation.wall_distance),
        gravity=(gravity[0], gravity[1], gravity[2]),
        boundary=simulation.boundary,
        density=float(simulation.density),
        domain=domain_of(simulation.domain),
        friction=float(simulation.friction),
        **({} if scene is None else surroundings_from(scene)),
    )
    settings.require_walls_that_hold()
    return settings


def skips_from(simulation: Computation) -> Skips:
    """The switches of `simulation.skip.*`."""
    return Skips(**simulation.skip)


def execution_from(config: SimulatingCommand) -> Execution:
    """How `precision=`, `device=` and `simulation.skip.*` have simulations computed."""
    return Execution(precision_from(config.precision), device_from(config.device), skips_from(config.simulation))


def start_from(config: SimulateConfig) -> SceneStart:
    """The scene of `scene.*`, of the material, its parameters and the settings of `simulation.*`.

    The CFL number of simulation.time_step=auto takes the start speed and the fall into account.
    """
    material = material_named(config.material.name)
    parameters = parameters_from(config.parameters, material)
    settings = settings_from(config.simulation, SimulationSettings.time_step, config.scene)
    body = body_from(config.scene)
    if body.density is not None and settings.density != SimulationSettings.density:
        raise _two_densities(settings.density)
    require_volume(body.volume, settings, _where(config.scene))
    require_inside(body.position, settings, _where(config.scene))
    file = config.scene.particles or config.scene.mesh
    name = config.scene.name or (Path(str(file)).stem if file else config.scene.shape)
    start = SceneStart(str(name), material.name, settings, parameters, **body._asdict())
    if config.simulation.time_step != "auto":
        return start
    return replace(
        start, settings=settings_from(config.simulation, stability_of(start).automatic_time_step, config.scene)
    )


def observation_from(config: EstimateConfig, material: Material) -> Observation:
    """The observation of `observation.*`, with the body of `scene.*` and the settings of `simulation.*` if given."""
    path = config.observation.file
    if not isinstance(path, str) or not path:
        raise UserError(
            f"observation.file={path or 'null'} is not accepted; accepted: the path of a trajectory file or a CSV file"
        )
    body = _observed_body(config.scene)
    if path.lower().endswith(".csv"):
        if body is None:
            raise UserError(
                f"{path}: markers need a body; accepted: scene.shape=cube, ..., scene.mesh=FILE or scene.particles=FILE"
            )
        settings = _observed_settings(config.simulation, config.scene, SimulationSettings())
        known = config.scene.velocity is not None or config.scene.particles is not None
        observation = from_table(path, material.name, settings, body, known)
    else:
        record = observed_record(path, config.observation.scene, material.name)
        observation = from_record(record, _observed_settings(config.simulation, config.scene, record.settings), body)
        if config.scene.velocity is not None:
            velocity, affine = _known_start(config.scene, observation.position, body)
            observation = replace(observation, initial_velocity=velocity, initial_affine=affine)
        elif body is None:
            observation = replace(observation, initial_affine=_observed_affine(config.scene, observation))
    if config.simulation.density is not None and observation.density is not None:
        raise _two_densities(config.simulation.density)
    observation = replace(observation, spins_have_gradient=_affine(config.scene) != "zero")
    window = config.observation.window
    return observation if window is None else observation.between(*_window(window))


def whole_number(value: object, option: str, least: int = 1) -> int:
    """The value of an option such as simulation.steps, a whole number of at least `least`."""
    if isinstance(value, bool) or not isinstance(value, int) or value < least:
        raise UserError(f"{option}={value} is not accepted; accepted: a whole number from {least}")
    return value


def device_from(device: str) -> torch.device:
    """The device of `device=`; `auto` is the GPU where there is one."""
    if device not in DEVICES:
        raise unknown_name("device", device, DEVICES)
    if device == "cuda" and not torch.cuda.is_available():
        raise UserError("device=cuda is not available here; accepted: cpu, auto")
    return torch.device("cuda" if device != "cpu" and torch.cuda.is_available() else "cpu")


def precision_from(precision: str) -> torch.dtype:
    """The floating-point type of `precision=`."""
    if precision not in PRECISIONS:
        raise unknown_name("precision", precision, PRECISIONS)
    return PRECISIONS[precision]


def use_processor(config: SimulatingCommand | CalibrateConfig) -> None:
    """Sets the number of CPU threads of `threads=`, null for PyTorch's own choice, and `simulation.backend`."""
    if config.threads is not None:
        torch.set_num_threads(whole_number(config.threads, "threads"))
    use_backend(config.simulation.backend)


def body_from(scene: Scene) -> PointCloud:
    """The particles of the scene with their velocities; those of a file keep the file's under the added ones.

    A point file or a mesh goes before scene.shape, which has a default; there is only one of the two.
    """
    centre = list(scene.centre)
    if scene.particles is not None and scene.mesh is not None:
        raise UserError(
            f"scene.mesh={scene.mesh} and scene.particles={scene.particles} are two bodies; accepted: one of them"
        )
    if scene.particles is not None:
        body, centre = read_point_file(str(scene.particles), scene.name), None
    elif scene.mesh is not None:
        body = mesh_particles(str(scene.mesh), centre, scene.side, scene.particles_per_edge, scene.lattice)
    else:
        body = particles(scene.shape, centre, scene.side, scene.particles_per_edge, scene.lattice)
    velocity = spin_velocity(body.position, body.velocity + list(scene.velocity), list(scene.spin), centre)
    return body._replace(velocity=velocity, affine=_start_affine(scene, body))


def _affine(scene: Scene) -> str:
    """The word of `scene.affine`."""
    if scene.affine not in AFFINES:
        raise unknown_name("scene.affine", scene.affine, AFFINES)
    return scene.affine


def _start_affine(scene: Scene, body: PointCloud) -> Float[np.ndarray, "particles 3 3"] | None:
    """C of a body and of the spin that is added to it; None for 0.

    body  with velocities of its own, of a file, and the C that a trajectory file says
    """
    word, points = _affine(scene), str(scene.particles or "").lower().endswith(".npz")
    if word == "zero":
        return None
    own = body.affine
    if word == "velocity" or points:
        own = velocity_gradients(body.position, body.velocity, body.volume)
    affine = np.zeros((len(body.position), 3, 3)) if own is None else own
    affine = affine + spin_gradient(list(scene.spin))
    return affine if affine.any() else None


def _observed_affine(scene: Scene, observation: Observation) -> Float[np.ndarray, "particles 3 3"] | None:
    """C of the start that a trajectory file shows; None for 0, and where the start velocity is not known."""
    velocity, word = observation.initial_velocity, _affine(scene)
    if velocity is None or word == "zero":
        return None
    if word == "velocity":
        return velocity_gradients(observation.position, velocity, observation.volume)
    return observation.initial_affine


def _two_densities(density: float) -> UserError:
    return UserError(
        f"simulation.density={density:g} has no effect on particles that bring their density; accepted: one of the two"
    )


def _where(scene: Scene) -> str:
    if scene.particles is not None:
        return f"scene.particles={scene.particles}"
    body = f"scene.shape={scene.shape}" if scene.mesh is None else f"scene.mesh={scene.mesh}"
    return f"{body} scene.centre={list(scene.centre)} scene.side={scene.side}"


def _observed_body(scene: Scene) -> PointCloud | None:
    """The body of `scene.*`; None where it says nothing."""
    if scene.shape is None and scene.particles is None and scene.mesh is None:
        return None
    return body_from(replace(scene, **_known_motion(scene)))


def _known_motion(scene: Scene) -> dict[str, list[float]]:
    """Velocity and spin of the start as far as `scene.*` says, zeros otherwise."""
    known = scene.velocity is not None
    given = {"velocity": scene.velocity or [0.0, 0.0, 0.0], "spin": (scene.spin if known else None) or [0.0, 0.0, 0.0]}
    for name, vector in given.items():
        if len(vector) != 3 or any(isinstance(x, (bool, str)) for x in vector):
            raise UserError(f"scene.{name}={list(vector)} is not accepted; accepted: three numbers")
    return {name: [float(x) for x in vector] for name, vector in given.items()}


def _known_start(
    scene: Scene, position: Float[np.ndarray, "particles 3"], body: PointCloud | None
) -> tuple[Float[np.ndarray, "particles 3"], Float[np.ndarray, "particles 3 3"] | None]:
    """Velocities and C of `scene.velocity` and `scene.spin`, of the body of `scene.*` or of the file's particles."""
    if body is not None:
        return body.velocity, body.affine
    given = _known_motion(scene)
    velocity = np.broadcast_to(np.array(given["velocity"]), position.shape)
    turning = _affine(scene) != "zero" and any(given["spin"])
    affine = np.tile(spin_gradient(given["spin"]), (len(position), 1, 1)) if turning else None
    return spin_velocity(position, velocity, given["spin"]), affine


def _observed_settings(simulation: ObservedSimulation, scene: Scene, own: SimulationSettings) -> SimulationSettings:
    """The observation's settings with what `simulation.*` says instead."""
    names = ("time_step", "grid_spacing", "wall_distance", "gravity", "boundary", "density", "friction", "domain")
    given = {name: value for name in names if (value := getattr(simulation, name)) is not None}
    if "gravity" in given:
        given["gravity"] = tuple(float(component) for component in given["gravity"])
    if "domain" in given:
        given["domain"] = domain_of(given["domain"])
    spacing = grid_spacing_from(simulation)
    given |= surroundings_from(scene) | ({} if spacing is None else {"grid_spacing": spacing})
    settings = replace(own, **given)
    # those of a file may be thinner, as long as the motion lets them
    if own.walls_hold or "wall_distance" in given:
        settings.require_walls_that_hold()
    return settings


def _window(window: object) -> tuple[float, float]:
    if not isinstance(window, list) or len(window) != 2 or any(isinstance(end, (bool, str)) for end in window):
        raise UserError(f"observation.window={window} is not accepted; accepted: two times [s]")
    return float(window[0]), float(window[1])
