"""Objects of the package from typed options: each option is checked where its object is made."""

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np
import torch
from jaxtyping import Float

from pcnclaws.commands.surroundings import domain_of, grid_spacing_from, surroundings_from
from pcnclaws.commands.typed_configs import CalibrateConfig, Number, SimulateConfig, SimulatingCommand
from pcnclaws.commands.typed_groups import Computation, Scene, Simulation
from pcnclaws.compiled.backend import use_backend
from pcnclaws.errors import UserError, unknown_name
from pcnclaws.geometry.shapes import PointCloud, mesh_particles, particles, spin_velocity
from pcnclaws.geometry.velocity_gradients import spin_gradient, velocity_gradients
from pcnclaws.interface.settings import two_densities
from pcnclaws.laws.materials import Material, material_named
from pcnclaws.laws.parameters import validate_parameters
from pcnclaws.mpm.settings import SimulationSettings
from pcnclaws.simulation.execution import Execution
from pcnclaws.simulation.fast_paths import Skips
from pcnclaws.simulation.placement import require_inside, require_loaded, require_volume
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
    simulation: Simulation, material: Material, automatic: float | None = None, scene: Scene | None = None
) -> SimulationSettings:
    """The settings of `simulation.*`, whose walls hold.

    material   whose density it is where simulation.density is null
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
        density=float(material.density if simulation.density is None else simulation.density),
        domain=domain_of(simulation.domain),
        friction=float(simulation.friction),
        transfer=simulation.transfer,
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
    settings = settings_from(config.simulation, material, SimulationSettings.time_step, config.scene)
    if config.scene.frame is not None:
        return _going_on(config, material, parameters, settings)
    body = body_from(config.scene)
    if body.density is not None and config.simulation.density is not None:
        raise two_densities(settings.density)
    require_volume(body.volume, settings, _where(config.scene))
    require_inside(body.position, settings, _where(config.scene))
    require_loaded(body.position, settings, "scene")
    file = config.scene.particles or config.scene.mesh
    name = config.scene.name or (Path(str(file)).stem if file else config.scene.shape)
    start = SceneStart(str(name), material.name, settings, parameters, **body._asdict())
    if config.simulation.time_step != "auto":
        return start
    return replace(start, settings=replace(settings, time_step=stability_of(start).automatic_time_step))


def _going_on(
    config: SimulateConfig, material: Material, parameters: Mapping[str, float], settings: SimulationSettings
) -> SceneStart:
    """The scene of `scene.particles` from the frame of `scene.frame` on, with what the options say beside its state."""
    from pcnclaws.data.restart_files import read_restart  # loads SciPy

    scene = config.scene
    later = read_restart(str(scene.particles), scene.name, scene.frame)
    if config.simulation.time_step == "auto":
        settings = replace(settings, time_step=later.time_step)
    start = later.going_on(material.name, parameters, settings, with_time=scene.start_time is None)
    if start.density is not None and config.simulation.density is not None:
        raise two_densities(settings.density)
    return replace(start, name=str(scene.name or Path(str(scene.particles)).stem))


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
        from pcnclaws.data.point_files import read_point_file  # loads SciPy

        body, centre = read_point_file(str(scene.particles), scene.name), None
    elif scene.mesh is not None:
        body = mesh_particles(str(scene.mesh), centre, scene.side, scene.particles_per_edge, scene.lattice)
    else:
        body = particles(scene.shape, centre, scene.side, scene.particles_per_edge, scene.lattice)
    velocity = spin_velocity(body.position, body.velocity + list(scene.velocity), list(scene.spin), centre)
    return body._replace(velocity=velocity, affine=_start_affine(scene, body))


def affine_word(scene: Scene) -> str:
    """The word of `scene.affine`."""
    if scene.affine not in AFFINES:
        raise unknown_name("scene.affine", scene.affine, AFFINES)
    return scene.affine


def _start_affine(scene: Scene, body: PointCloud) -> Float[np.ndarray, "particles 3 3"] | None:
    """C of a body and of the spin that is added to it; None for 0.

    body  with velocities of its own, of a file, and the C that a trajectory file says
    """
    word, points = affine_word(scene), str(scene.particles or "").lower().endswith((".npz", ".ply"))
    if word == "zero":
        return None
    own = body.affine
    if word == "velocity" or points:
        own = velocity_gradients(body.position, body.velocity, body.volume)
    affine = np.zeros((len(body.position), 3, 3)) if own is None else own
    affine = affine + spin_gradient(list(scene.spin))
    return affine if affine.any() else None


def _where(scene: Scene) -> str:
    if scene.particles is not None:
        return f"scene.particles={scene.particles}"
    body = f"scene.shape={scene.shape}" if scene.mesh is None else f"scene.mesh={scene.mesh}"
    return f"{body} scene.centre={list(scene.centre)} scene.side={scene.side}"
