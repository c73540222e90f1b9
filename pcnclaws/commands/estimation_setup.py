"""Unknowns of an estimation and the start of its search, from typed options."""

import logging
from collections.abc import Mapping

import numpy as np
from rich.console import Console

from pcnclaws.commands.configuration import whole_number
from pcnclaws.commands.typed_configs import EstimateConfig
from pcnclaws.data.observation import Observation
from pcnclaws.errors import UserError, unknown_name
from pcnclaws.estimation.inverse import EstimatorSettings
from pcnclaws.estimation.problem import EstimationProblem
from pcnclaws.estimation.screening import screened_start, stable_start
from pcnclaws.estimation.start_motion import with_first_motion
from pcnclaws.estimation.transforms import transform_of
from pcnclaws.estimation.unknowns import FRICTION, GRID_SPACING, Unknowns, components_of, make_unknowns
from pcnclaws.laws.materials import Material
from pcnclaws.laws.parameters import PARAMETERS

log = logging.getLogger(__name__)

REFINEMENTS = "accepted: numbers above 1 that increase, such as [1.5,2.5]"


def estimator_from(config: EstimateConfig) -> EstimatorSettings:
    """The settings of `estimator.*`."""
    return EstimatorSettings(
        str(config.estimator.name),
        whole_number(config.estimator.iterations, "estimator.iterations"),
        float(config.estimator.learning_rate),
    )


def noise_from(config: EstimateConfig) -> float | None:
    """The standard deviation of observed coordinates [m] of `observation.noise`, None where it is not known."""
    noise = config.observation.noise
    if noise is None:
        return None
    if isinstance(noise, bool) or not isinstance(noise, (int, float)) or not (0.0 < noise < np.inf):
        raise UserError(
            f"observation.noise={noise} is not accepted; accepted: above 0 and finite [m], or null to take it from the "
            "positions"
        )
    return float(noise)


def unknowns_from(config: EstimateConfig, material: Material, observation: Observation) -> Unknowns:
    """What is sought: the parameters but for `fixed.*`, where they `vary`, and what `unknown.*` adds."""
    fixed = _given("fixed", config.fixed, material)
    for name, value in fixed.items():
        if not PARAMETERS[name].accepts(value):
            raise UserError(f"fixed.{name}={value:g} is not accepted; accepted: {PARAMETERS[name].accepted}")
    motion = config.unknown.motion
    if motion not in ("auto", True, False):
        raise UserError(f"unknown.motion={motion} is not accepted; accepted: true, false, auto")
    sought = observation.initial_velocity is None if motion == "auto" else bool(motion)
    if not sought and observation.initial_velocity is None:
        raise UserError("unknown.motion=false needs a start velocity; accepted: scene.velocity=[..], or auto")
    spacing, position = observation.spacing, observation.position
    components = components_of(str(config.vary), position, spacing)
    bodies = components if config.vary == "bodies" else components_of("uniform", position, spacing)
    return make_unknowns(
        material.parameter_names,
        fixed,
        components,
        bodies,
        motion=sought,
        time_offset=bool(config.unknown.time_offset),
        surface_offset=_surface_offset(config.unknown.surface_offset, observation),
        walls=_surrounding(config, "walls"),
        friction=_surrounding(config, "friction", observation),
        gravity=_surrounding(config, "gravity", observation),
        size=_surrounding(config, "size", observation),
        grid_spacing=len(refinements_from(config)) > 1,
    )


def _surface_offset(word: bool | str, observation: Observation) -> bool:
    """Whether the offset of the surface is sought."""
    if word not in ("auto", True, False):
        raise UserError(f"unknown.surface_offset={word} is not accepted; accepted: true, false, auto")
    return observation.points is not None and bool(word)


def _surrounding(config: EstimateConfig, name: str, observation: Observation | None = None) -> bool:
    """Whether `unknown.walls`, `unknown.friction`, `unknown.gravity` or `unknown.size` is sought."""
    option = f"unknown.{name}=true"
    if not getattr(config.unknown, name):
        return False
    if config.estimator.name != "gauss_newton":
        raise UserError(
            f"{option} is not accepted with estimator={config.estimator.name}; accepted: estimator=gauss_newton"
        )
    settings = observation.settings if observation else None
    if name == "friction" and settings and settings.boundary != "separate":
        raise UserError(f"{option} is not accepted with boundary '{settings.boundary}'; accepted: separate")
    if name == "gravity" and settings and not any(settings.gravity):
        raise UserError(f"{option} is not accepted without gravity; accepted: simulation.gravity other than 0")
    if name == "size" and observation and (observation.points is not None or observation.particle.shape[1] == 1):
        raise UserError(f"{option} needs markers on a body; accepted: scene.shape=cube, ... or scene.mesh=FILE")
    return True


def refinements_from(config: EstimateConfig) -> list[float]:
    """By how much finer grids are than the one of the search; none where the option says nothing."""
    given, option = config.refinements, f"refinements={config.refinements}"
    if given is None:
        return []
    if not isinstance(given, list) or any(isinstance(x, bool) or not isinstance(x, (int, float)) for x in given):
        raise UserError(f"{option} is not accepted; {REFINEMENTS}")
    if any(fine <= coarse for coarse, fine in zip([1.0, *given], given, strict=False)):
        raise UserError(f"{option} is not accepted; {REFINEMENTS}")
    if given and config.observation.kind == "points":
        raise UserError(f"{option} is not accepted with observation.kind=points; accepted: markers")
    if given and config.estimator.name != "gauss_newton":
        raise UserError(
            f"{option} is not accepted with estimator={config.estimator.name}; accepted: estimator=gauss_newton"
        )
    if given and config.scene.shape is None and config.scene.mesh is None:
        raise UserError(
            f"{option} is not accepted with the particles of a file; accepted: scene.shape=cube, ... or scene.mesh=FILE"
        )
    return [float(x) for x in given]


def discrepancy_asked(config: EstimateConfig) -> bool:
    """Whether intervals are to reckon with the error of a model that does not fit the motion."""
    if config.discrepancy and config.observation.kind == "points":
        raise UserError("discrepancy=true is not accepted with observation.kind=points; accepted: markers")
    return config.discrepancy


def guess_from(config: EstimateConfig, material: Material, problem: EstimationProblem) -> np.ndarray:
    """Coordinates of initial_guess: the middle of the material's ranges where it says nothing, put inside bounds."""
    given = _given("initial_guess", config.initial_guess, material)
    inside: dict[str, float] = {}
    for name in material.parameter_names:
        value, limits = given.get(name, material.defaults[name]), PARAMETERS[name]
        if not limits.lower <= value <= limits.upper or (value == 0.0 and limits.unit == "Pa"):
            raise UserError(f"initial_guess.{name}={value:g} is not accepted; accepted: {limits.accepted}")
        inside[name] = transform_of(limits).inside(value)
        if inside[name] != value and name not in problem.unknowns.fixed:
            log.warning(
                "initial_guess.%s=%g is at the edge of what is possible: starts from %.4g", name, value, inside[name]
            )
    sought = problem.unknowns.sought
    rubbing = problem.observation.settings.friction
    inside |= {unknown.name: unknown.transform.inside(rubbing) for unknown in sought if unknown.name == FRICTION}
    inside[GRID_SPACING] = problem.observation.settings.grid_spacing
    values = np.array([inside.get(unknown.name, 0.0) for unknown in sought])
    if problem.observation.initial_velocity is None:
        values = with_first_motion(problem.observation, problem.unknowns, values)
    u = problem.unknowns.coordinates(values.tolist())
    stable = stable_start(problem, u)
    if not np.array_equal(u, stable):
        softer = problem.unknowns.values(stable)[problem.unknowns.index("youngs_modulus")[0]]
        log.warning(
            "initial_guess.youngs_modulus=%g is unstable with the observation's time step: starts from %.3g",
            inside["youngs_modulus"],
            softer,
        )
    return stable


def start_from_guess(
    config: EstimateConfig, problem: EstimationProblem, guess: np.ndarray, console: Console
) -> np.ndarray:
    """The best of the guess and of the `screening` starts."""
    count = whole_number(config.screening, "screening", least=0)
    if not count:
        return guess
    start, errors = screened_start(problem, guess, count, int(config.seed))
    best = min(errors)
    console.print(f"screening: {count + 1} starts, MSE {errors[0]:.1e} m² of the guess, {best:.1e} m² of the best")
    return start


def _given(option: str, values: Mapping[str, object], material: Material) -> dict[str, float]:
    """The numbers of initial_guess or fixed that are not null; UserError for one that the material does not have."""
    given: dict[str, float] = {}
    for name, value in values.items():
        if value is None:
            continue
        if name not in material.parameter_names:
            raise unknown_name(option, name, material.parameter_names)
        if isinstance(value, bool) or not isinstance(value, (int, float)):
            raise UserError(f"{option}.{name}={value} is not accepted; accepted: a number")
        given[name] = float(value)
    return given
