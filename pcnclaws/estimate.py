"""Estimates physical parameters from motion: python -m pcnclaws.estimate material=sand observation.file=x.h5."""

import logging
import shutil
import time
from pathlib import Path
from typing import Any

import numpy as np
import yaml
from omegaconf import DictConfig, OmegaConf
from rich.console import Console

from pcnclaws import launcher
from pcnclaws.configuration import (
    material_from,
    observation_from,
    output_file,
    precision_from,
    use_processor,
    whole_number,
)
from pcnclaws.data.hdf5 import write_scenes
from pcnclaws.data.observation import Observation
from pcnclaws.data.observation_files import stored_truth
from pcnclaws.data.scenes import simulate_records
from pcnclaws.errors import UserError, unknown_name
from pcnclaws.estimation.law_error import known_law_error
from pcnclaws.estimation.problem import EstimationProblem
from pcnclaws.estimation.screening import screened_start, stable_start
from pcnclaws.estimation.start_motion import with_first_motion
from pcnclaws.estimation.transforms import TRANSFORMS
from pcnclaws.estimation.uncertainty import Uncertainty, uncertainty
from pcnclaws.estimation.unknowns import Unknowns, components_of, make_unknowns
from pcnclaws.estimation_report import leave_estimation_pictures, result_table, result_values, verdicts
from pcnclaws.evaluation.provenance import provenance
from pcnclaws.evaluation.report import write_metrics
from pcnclaws.laws.materials import Laws, Material
from pcnclaws.laws.parameters import PARAMETERS
from pcnclaws.runs import law_folder, laws_for
from pcnclaws.training.fit import quiet_lightning
from pcnclaws.training.fit_inverse import fit_inverse
from pcnclaws.training.inverse import EstimatorSettings, InverseModule

log = logging.getLogger(__name__)

PLAIN_WIDTH = 120
# Options that do not change what a search does: an interrupted one goes on under others.
FREE_OPTIONS = ("output", "overwrite", "picture", "trajectory", "threads", "paths")


def estimate(config: DictConfig) -> None:
    """Searches the parameters that explain the observation, and writes them to `output` with their intervals."""
    started = time.monotonic()
    output = output_file(config)
    use_processor(config)
    quiet_lightning()
    console = Console() if Console().is_terminal else Console(width=PLAIN_WIDTH)
    material = material_from(config)
    estimator = _estimator(config)
    observation = observation_from(config, material)
    unknowns = _unknowns(config, material, observation)
    laws, law_error = laws_for(str(config.law), material), known_law_error(law_folder(str(config.law), material))
    problem = EstimationProblem(laws, observation, unknowns, precision_from(config))

    guess = _guess(config, material, problem)
    module = InverseModule(problem, _start(config, problem, guess, console), estimator)
    folder = _search_folder(config, output)
    fit_inverse(module, folder, console)
    found = uncertainty(module.linearisation(), unknowns, module.u, law_error)

    truth = stored_truth(observation, material.parameter_names)
    title = f"{material.name}, law {config.law}, {observation.name}: {observation.seen.sum()} positions"
    guessed = unknowns.values(guess).tolist()
    fixed = {name: float(values[0]) for name, values in unknowns.fixed.items()}
    console.print(result_table(title, guessed, found, truth, fixed))
    for line in verdicts(found):
        console.print(line)
    mse = module.linearisation().mse
    values = {
        "material": material.name,
        "law": str(config.law),
        "observation": str(config.observation.file),
        "estimator": estimator.name,
        **result_values(unknowns, guessed, found, truth),
        "mse": mse,
        "iterations": len(module.history),
        "history": [{"values": list(numbers), "mse": error} for numbers, error in module.history],
        "seconds": round(time.monotonic() - started, 1),
        "provenance": provenance(config.seed) | {"precision": config.precision},
    }
    for path in _extras(config, output, title, module, found, laws):
        console.print(f"wrote {path}")
    write_metrics(output, values)
    shutil.rmtree(folder / "checkpoints", ignore_errors=True)
    console.print(f"wrote {output}: MSE {mse:.2e} m^2 in {values['seconds']:g} s")


def _estimator(config: DictConfig) -> EstimatorSettings:
    return EstimatorSettings(
        str(config.estimator.name),
        whole_number(config, "estimator.iterations"),
        float(config.estimator.learning_rate),
    )


def _unknowns(config: DictConfig, material: Material, observation: Observation) -> Unknowns:
    fixed = _given(config, "fixed", material)
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
    return make_unknowns(material.parameter_names, fixed, components, bodies, sought, bool(config.unknown.time_offset))


def _guess(config: DictConfig, material: Material, problem: EstimationProblem) -> np.ndarray:
    """Coordinates of initial_guess: the middle of the material's ranges where it says nothing, put inside bounds."""
    given = _given(config, "initial_guess", material)
    inside: dict[str, float] = {}
    for name in material.parameter_names:
        value, limits = given.get(name, material.defaults[name]), PARAMETERS[name]
        if not limits.lower <= value <= limits.upper or (value == 0.0 and limits.unit == "Pa"):
            raise UserError(f"initial_guess.{name}={value:g} is not accepted; accepted: {limits.accepted}")
        inside[name] = TRANSFORMS[name].inside(value)
        if inside[name] != value and name not in problem.unknowns.fixed:
            log.warning(
                "initial_guess.%s=%g is at the edge of what is possible: starts from %.4g", name, value, inside[name]
            )
    sought = problem.unknowns.sought
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


def _start(config: DictConfig, problem: EstimationProblem, guess: np.ndarray, console: Console) -> np.ndarray:
    count = whole_number(config, "screening", least=0)
    if not count:
        return guess
    start, errors = screened_start(problem, guess, count, int(config.seed))
    best = min(errors)
    console.print(f"screening: {count + 1} starts, MSE {errors[0]:.1e} m² of the guess, {best:.1e} m² of the best")
    return start


def _given(config: DictConfig, option: str, material: Material) -> dict[str, float]:
    """The numbers of initial_guess or fixed that are not null; UserError for one that the material does not have."""
    given = {str(name): value for name, value in config[option].items() if value is not None}
    for name, value in given.items():
        if name not in material.parameter_names:
            raise unknown_name(option, name, material.parameter_names)
        if isinstance(value, bool) or not isinstance(value, (int, float)):
            raise UserError(f"{option}.{name}={value} is not accepted; accepted: a number")
    return {name: float(value) for name, value in given.items()}


def _search_folder(config: DictConfig, output: Path) -> Path:
    """Where an interrupted search is kept, beside the output; one of other options is not gone on with."""
    folder = output.with_suffix("") if output.suffix else output.with_name(f"{output.name}_search")
    options = OmegaConf.to_container(config)
    assert isinstance(options, dict)  # noqa: S101
    asked = {str(key): value for key, value in options.items() if key not in FREE_OPTIONS}
    noted = folder / "search.yaml"
    if folder.exists() and not folder.is_dir():
        raise UserError(f"output={output}: {folder} is a file, and the search needs a folder of that name")
    same = noted.is_file() and yaml.safe_load(noted.read_text(encoding="utf-8")) == asked
    if config.overwrite or not same:
        for name in ("checkpoints", "tensorboard"):
            shutil.rmtree(folder / name, ignore_errors=True)
    folder.mkdir(parents=True, exist_ok=True)
    noted.write_text(yaml.safe_dump(asked), encoding="utf-8")
    return folder


def _extras(
    config: DictConfig, output: Path, title: str, module: InverseModule, found: Uncertainty, laws: Laws
) -> list[Path]:
    """Pictures and the simulated trajectory, as far as they are asked for."""
    observation, problem, u = module.problem.observation, module.problem, module.u
    stem = output.with_suffix("") if output.suffix else output
    written = []
    if config.trajectory:
        path = stem.with_name(f"{stem.name}_simulated.h5")
        _write_trajectory(path, problem, u, laws, precision_from(config))
        written.append(path)
    if config.picture:
        truth = stored_truth(observation, tuple(unknown.name for unknown in problem.unknowns.sought))
        motion = problem.motion(u)
        written += leave_estimation_pictures(stem, title, observation, motion, module.history, found, truth)
    return written


def _write_trajectory(path: Path, problem: EstimationProblem, u: np.ndarray, laws: Laws, dtype: Any) -> None:
    """The body's motion with the estimate, all particles of it."""
    observation = problem.observation
    start = problem.start(u)
    steps = int(np.ceil(observation.time[-1] / observation.settings.time_step - 1e-6))
    write_scenes(
        path, simulate_records([start], laws, max(steps, 1), max(steps // 100, 1), dtype=dtype, velocities=True)
    )


def main() -> None:
    """The command."""
    launcher.main(estimate, "estimate")


if __name__ == "__main__":
    main()
