"""Observation of an estimation, from typed options: the file, its body and its settings."""

from dataclasses import replace

import numpy as np
from jaxtyping import Float

from pcnclaws.commands.capture_options import capture_of
from pcnclaws.commands.configuration import affine_word, body_from
from pcnclaws.commands.surroundings import domain_of, grid_spacing_from, surroundings_from
from pcnclaws.commands.typed_configs import EstimateConfig
from pcnclaws.commands.typed_groups import ObservedSimulation, Scene
from pcnclaws.data.c3d_files import ENDING
from pcnclaws.data.motion_capture import Capture
from pcnclaws.data.observation import Observation
from pcnclaws.data.observation_files import from_record, from_table, observed_record
from pcnclaws.data.point_observation import from_points
from pcnclaws.errors import UserError, unknown_name
from pcnclaws.geometry.shapes import PointCloud, spin_velocity
from pcnclaws.geometry.velocity_gradients import spin_gradient, velocity_gradients
from pcnclaws.interface.settings import two_densities
from pcnclaws.laws.materials import Material
from pcnclaws.mpm.settings import SimulationSettings

KINDS = ("markers", "points")
# Of files of markers; the others are trajectory files.
MARKER_ENDINGS = (".csv", ENDING)


def observation_from(config: EstimateConfig, material: Material) -> Observation:
    """The observation of `observation.*`, with the body of `scene.*` and the settings of `simulation.*` if given."""
    path = config.observation.file
    if not isinstance(path, str) or not path:
        raise UserError(
            f"observation.file={path or 'null'} is not accepted; accepted: the path of a trajectory file, a CSV "
            "file or a C3D file"
        )
    body = _observed_body(config.scene)
    if config.observation.kind not in KINDS:
        raise unknown_name("observation.kind", config.observation.kind, KINDS)
    if config.observation.kind == "points":
        observation = _points(config, material, path, body)
    elif path.lower().endswith(MARKER_ENDINGS):
        if body is None:
            raise UserError(
                f"{path}: markers need a body; accepted: scene.shape=cube, ..., scene.mesh=FILE or scene.particles=FILE"
            )
        settings = _observed_settings(config.simulation, config.scene, _unsaid(material))
        known = config.scene.velocity is not None or config.scene.particles is not None
        capture = capture_of(config.observation)
        observation = from_table(path, material.name, settings, body, known, capture=capture)
    else:
        record = observed_record(path, config.observation.scene, material.name)
        observation = from_record(record, _observed_settings(config.simulation, config.scene, record.settings), body)
        if config.scene.velocity is not None:
            velocity, affine = _known_start(config.scene, observation.position, body)
            observation = replace(observation, initial_velocity=velocity, initial_affine=affine)
        elif body is None:
            observation = replace(observation, initial_affine=_observed_affine(config.scene, observation))
    if config.simulation.density is not None and observation.density is not None:
        raise two_densities(config.simulation.density)
    observation = replace(observation, spins_have_gradient=affine_word(config.scene) != "zero")
    window = config.observation.window
    return observation if window is None else observation.between(*_window(window))


def _points(config: EstimateConfig, material: Material, path: str, body: PointCloud | None) -> Observation:
    """The observation of unlabelled points."""
    observed, scene = config.observation, config.scene
    if body is None:
        raise UserError(
            f"{path}: points need a body; accepted: scene.shape=cube, ..., scene.mesh=FILE or scene.particles=FILE"
        )
    capture = capture_of(observed) or Capture()
    return from_points(
        path,
        material.name,
        _observed_settings(config.simulation, scene, _unsaid(material)),
        body,
        velocity_known=scene.velocity is not None or scene.particles is not None,
        units=capture.units or "m",
        start=capture.start or 0.0,
    )


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
    turning = affine_word(scene) != "zero" and any(given["spin"])
    affine = np.tile(spin_gradient(given["spin"]), (len(position), 1, 1)) if turning else None
    return spin_velocity(position, velocity, given["spin"]), affine


def _observed_affine(scene: Scene, observation: Observation) -> Float[np.ndarray, "particles 3 3"] | None:
    """C of the start that a trajectory file shows; None for 0, and where the start velocity is not known."""
    velocity, word = observation.initial_velocity, affine_word(scene)
    if velocity is None or word == "zero":
        return None
    if word == "velocity":
        return velocity_gradients(observation.position, velocity, observation.volume)
    return observation.initial_affine


def _unsaid(material: Material) -> SimulationSettings:
    """The settings of an observation that says none."""
    return SimulationSettings(density=float(material.density))


def _observed_settings(simulation: ObservedSimulation, scene: Scene, own: SimulationSettings) -> SimulationSettings:
    """The observation's settings with what `simulation.*` says instead."""
    of_grid = ("time_step", "domain", "grid_spacing", "wall_distance", "transfer")
    names = (*of_grid, "gravity", "boundary", "density", "friction")
    given = {name: value for name in names if (value := getattr(simulation, name)) is not None}
    if isinstance(given.get("time_step"), str):
        raise UserError(
            f"simulation.time_step={given['time_step']} is not accepted here; accepted: a positive number [s], or "
            "null for that of the observation"
        )
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
