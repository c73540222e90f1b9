"""From the composed configuration to objects, each option checked where its object is made."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import torch
from jaxtyping import Float
from omegaconf import DictConfig, OmegaConf

from pcnclaws.commands.surroundings import domain_of, grid_spacing_from, surroundings_from
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


def material_from(config: DictConfig) -> Material:
    """The material of `material=`."""
    return material_named(str(config.material.name))


def parameters_from(config: DictConfig, material: Material) -> dict[str, float]:
    """The physical parameters of `parameters.*`, checked."""
    values = {str(name): float(value) for name, value in config.parameters.items()}
    validate_parameters(values, material.parameter_names)
    return values


def settings_from(config: DictConfig, automatic: float | None = None) -> SimulationSettings:
    """The settings of `simulation.*`, whose walls hold.

    automatic  the time step [s] that simulation.time_step=auto stands for, None where it is not accepted
    """
    simulation = config.simulation
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
        **surroundings_from(config.scene),
    )
    settings.require_walls_that_hold()
    return settings


def skips_from(config: DictConfig) -> Skips:
    """The switches of `simulation.skip.*`."""
    return Skips(**{str(switch): bool(on) for switch, on in config.simulation.skip.items()})


def execution_from(config: DictConfig) -> Execution:
    """How `precision=`, `device=` and `simulation.skip.*` have simulations computed."""
    return Execution(precision_from(config), device_from(config), skips_from(config))


def start_from(config: DictConfig) -> SceneStart:
    """The scene of `scene.*`, of the material, its parameters and the settings of `simulation.*`.

    The CFL number of simulation.time_step=auto takes the start speed and the fall into account.
    """
    material = material_from(config)
    parameters = parameters_from(config, material)
    settings = settings_from(config, automatic=SimulationSettings.time_step)
    body = body_from(config)
    if body.density is not None and settings.density != SimulationSettings.density:
        raise _two_densities(config)
    require_volume(body.volume, settings, _where(config))
    require_inside(body.position, settings, _where(config))
    file = config.scene.particles or config.scene.mesh
    name = config.scene.name or (Path(str(file)).stem if file else config.scene.shape)
    start = SceneStart(str(name), material.name, settings, parameters, **body._asdict())
    if config.simulation.time_step != "auto":
        return start
    return replace(start, settings=settings_from(config, stability_of(start).automatic_time_step))


def observation_from(config: DictConfig, material: Material) -> Observation:
    """The observation of `observation.*`, with the body of `scene.*` and the settings of `simulation.*` if given."""
    path = config.observation.file
    if not isinstance(path, str) or not path:
        raise UserError(
            f"observation.file={path or 'null'} is not accepted; accepted: the path of a trajectory file or a CSV file"
        )
    body = _observed_body(config)
    if path.lower().endswith(".csv"):
        if body is None:
            raise UserError(
                f"{path}: markers need a body; accepted: scene.shape=cube, ..., scene.mesh=FILE or scene.particles=FILE"
            )
        settings = _observed_settings(config, SimulationSettings())
        known = config.scene.velocity is not None or config.scene.particles is not None
        observation = from_table(path, material.name, settings, body, known)
    else:
        record = observed_record(path, config.observation.scene, material.name)
        observation = from_record(record, _observed_settings(config, record.settings), body)
        if config.scene.velocity is not None:
            velocity, affine = _known_start(config, observation.position, body)
            observation = replace(observation, initial_velocity=velocity, initial_affine=affine)
        elif body is None:
            observation = replace(observation, initial_affine=_observed_affine(config, observation))
    if config.simulation.density is not None and observation.density is not None:
        raise _two_densities(config)
    observation = replace(observation, spins_have_gradient=_affine(config) != "zero")
    return observation if config.observation.window is None else observation.between(*_window(config))


def whole_number(config: DictConfig, option: str, least: int = 1) -> int:
    """The value of an option such as simulation.steps, a whole number of at least `least`."""
    value: Any = OmegaConf.select(config, option)
    if isinstance(value, bool) or not isinstance(value, int) or value < least:
        raise UserError(f"{option}={value} is not accepted; accepted: a whole number from {least}")
    return value


def device_from(config: DictConfig) -> torch.device:
    """The device of `device=`; `auto` is the GPU where there is one."""
    if config.device not in DEVICES:
        raise unknown_name("device", config.device, DEVICES)
    if config.device == "cuda" and not torch.cuda.is_available():
        raise UserError("device=cuda is not available here; accepted: cpu, auto")
    return torch.device("cuda" if config.device != "cpu" and torch.cuda.is_available() else "cpu")


def precision_from(config: DictConfig) -> torch.dtype:
    """The floating-point type of `precision=`."""
    if config.precision not in PRECISIONS:
        raise unknown_name("precision", config.precision, PRECISIONS)
    return PRECISIONS[config.precision]


def use_processor(config: DictConfig) -> None:
    """Sets the number of CPU threads of `threads=`, null for PyTorch's own choice, and `simulation.backend`."""
    if config.threads is not None:
        torch.set_num_threads(whole_number(config, "threads"))
    use_backend(str(config.simulation.backend))


def body_from(config: DictConfig) -> PointCloud:
    """The particles of the scene with their velocities; those of a file keep the file's under the added ones.

    A point file or a mesh goes before scene.shape, which has a default; there is only one of the two.
    """
    scene = config.scene
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
    return body._replace(velocity=velocity, affine=_start_affine(config, body))


def _affine(config: DictConfig) -> str:
    """The word of `scene.affine`."""
    if config.scene.affine not in AFFINES:
        raise unknown_name("scene.affine", config.scene.affine, AFFINES)
    return str(config.scene.affine)


def _start_affine(config: DictConfig, body: PointCloud) -> Float[np.ndarray, "particles 3 3"] | None:
    """C of a body and of the spin that is added to it; None for 0.

    body  with velocities of its own, of a file, and the C that a trajectory file says
    """
    word, points = _affine(config), str(config.scene.particles or "").lower().endswith(".npz")
    if word == "zero":
        return None
    own = body.affine
    if word == "velocity" or points:
        own = velocity_gradients(body.position, body.velocity, body.volume)
    affine = np.zeros((len(body.position), 3, 3)) if own is None else own
    affine = affine + spin_gradient(list(config.scene.spin))
    return affine if affine.any() else None


def _observed_affine(config: DictConfig, observation: Observation) -> Float[np.ndarray, "particles 3 3"] | None:
    """C of the start that a trajectory file shows; None for 0, and where the start velocity is not known."""
    velocity, word = observation.initial_velocity, _affine(config)
    if velocity is None or word == "zero":
        return None
    if word == "velocity":
        return velocity_gradients(observation.position, velocity, observation.volume)
    return observation.initial_affine


def _two_densities(config: DictConfig) -> UserError:
    return UserError(
        f"simulation.density={config.simulation.density} has no effect on particles that bring their density; "
        "accepted: one of the two"
    )


def _where(config: DictConfig) -> str:
    scene = config.scene
    if scene.particles is not None:
        return f"scene.particles={scene.particles}"
    body = f"scene.shape={scene.shape}" if scene.mesh is None else f"scene.mesh={scene.mesh}"
    return f"{body} scene.centre={list(scene.centre)} scene.side={scene.side}"


def _observed_body(config: DictConfig) -> PointCloud | None:
    """The body of `scene.*`; None where it says nothing."""
    scene = config.scene
    if scene.shape is None and scene.particles is None and scene.mesh is None:
        return None
    return body_from(OmegaConf.create({"scene": {**scene, **_known_motion(config)}}))


def _known_motion(config: DictConfig) -> dict[str, list[float]]:
    """Velocity and spin of the start as far as `scene.*` says, zeros otherwise."""
    scene = config.scene
    known = scene.velocity is not None
    given = {"velocity": scene.velocity or [0.0, 0.0, 0.0], "spin": (scene.spin if known else None) or [0.0, 0.0, 0.0]}
    for name, vector in given.items():
        if len(vector) != 3 or any(isinstance(x, (bool, str)) for x in vector):
            raise UserError(f"scene.{name}={list(vector)} is not accepted; accepted: three numbers")
    return {name: [float(x) for x in vector] for name, vector in given.items()}


def _known_start(
    config: DictConfig, position: Float[np.ndarray, "particles 3"], body: PointCloud | None
) -> tuple[Float[np.ndarray, "particles 3"], Float[np.ndarray, "particles 3 3"] | None]:
    """Velocities and C of `scene.velocity` and `scene.spin`, of the body of `scene.*` or of the file's particles."""
    if body is not None:
        return body.velocity, body.affine
    given = _known_motion(config)
    velocity = np.broadcast_to(np.array(given["velocity"]), position.shape)
    turning = _affine(config) != "zero" and any(given["spin"])
    affine = np.tile(spin_gradient(given["spin"]), (len(position), 1, 1)) if turning else None
    return spin_velocity(position, velocity, given["spin"]), affine


def _observed_settings(config: DictConfig, own: SimulationSettings) -> SimulationSettings:
    """The observation's settings with what `simulation.*` says instead."""
    names = ("time_step", "grid_spacing", "wall_distance", "gravity", "boundary", "density", "friction", "domain")
    given = {name: config.simulation[name] for name in names if config.simulation[name] is not None}
    if "gravity" in given:
        given["gravity"] = tuple(float(component) for component in given["gravity"])
    if "domain" in given:
        given["domain"] = domain_of(given["domain"])
    spacing = grid_spacing_from(config.simulation)
    given |= surroundings_from(config.scene) | ({} if spacing is None else {"grid_spacing": spacing})
    settings = replace(own, **given)
    # those of a file may be thinner, as long as the motion lets them
    if own.walls_hold or "wall_distance" in given:
        settings.require_walls_that_hold()
    return settings


def _window(config: DictConfig) -> tuple[float, float]:
    window = config.observation.window
    if not OmegaConf.is_list(window) or len(window) != 2 or any(isinstance(end, (bool, str)) for end in window):
        raise UserError(f"observation.window={window} is not accepted; accepted: two times [s]")
    return float(window[0]), float(window[1])
