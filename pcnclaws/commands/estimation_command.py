"""Estimation of physical parameters, from the observation to the result file and its pictures."""

import logging
import shutil
import time
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from rich.console import Console

from pcnclaws.commands.composition import is_of_sweep
from pcnclaws.commands.configuration import (
    execution_from,
    use_processor,
)
from pcnclaws.commands.estimation_folder import finished_search, search_folder, started_search
from pcnclaws.commands.estimation_refinement import refined_estimate, refined_problems
from pcnclaws.commands.estimation_report import (
    Findings,
    leave_estimation_pictures,
    result_table,
    result_values,
    verdicts,
)
from pcnclaws.commands.estimation_setup import (
    discrepancy_asked,
    estimator_from,
    guess_from,
    noise_from,
    start_from_guess,
    unknowns_from,
)
from pcnclaws.commands.estimation_uncertainty import LINEAR, Explored, explored, leave_explored, uncertainty_asked
from pcnclaws.commands.observation_setup import observation_from
from pcnclaws.commands.outputs import RESULT, output_file, scene_files
from pcnclaws.commands.runs import law_folder, laws_for, load_run
from pcnclaws.commands.typed_configs import EstimateConfig
from pcnclaws.data.hdf5 import write_scenes
from pcnclaws.data.locks import written_alone
from pcnclaws.data.observation_files import stored_truth
from pcnclaws.estimation.discrepancy import discrepancy_of, is_pattern
from pcnclaws.estimation.goodness_of_fit import Fit, fit_of
from pcnclaws.estimation.inverse import InverseModule
from pcnclaws.estimation.inverse_search import fit_inverse
from pcnclaws.estimation.law_error import known_law_error
from pcnclaws.estimation.problem import EstimationProblem
from pcnclaws.estimation.refinement import Stage
from pcnclaws.estimation.tensorboard_log import log_intervals
from pcnclaws.estimation.uncertainty import Uncertainty, uncertainty
from pcnclaws.evaluation.report import write_metrics
from pcnclaws.guards import counts
from pcnclaws.laws.materials import Material, material_named
from pcnclaws.laws.training_ranges import outside_training_data
from pcnclaws.provenance import provenance
from pcnclaws.simulation.execution import Execution
from pcnclaws.simulation.particle_spacing import warn_of_sparse_particles
from pcnclaws.simulation.recorded_runs import simulate_records
from pcnclaws.simulation.recording import FramePlan
from pcnclaws.training.trainer import quiet_lightning

log = logging.getLogger(__name__)

PLAIN_WIDTH = 120


def estimate(config: EstimateConfig) -> Mapping[str, float | None]:
    """Searches the parameters that explain the observation, and writes them to `output` with their intervals.

    returns  the estimates, the error of the fit, and the residual over the scatter of the positions
    """
    output = output_file(
        config.output, scene_files(config.scene) | {"observation.file": config.observation.file}, *RESULT
    )
    with written_alone(search_folder(output), f"output={output}"):
        if is_of_sweep() and (found := finished_search(config, output)) is not None:
            print(f"{output} holds this estimate, finished; overwrite=true makes it anew")
            return _numbers(found)
        return _estimate(config, output)


def _estimate(config: EstimateConfig, output: Path) -> Mapping[str, float | None]:
    started = time.monotonic()
    use_processor(config)
    quiet_lightning()
    console = Console() if Console().is_terminal else Console(width=PLAIN_WIDTH)
    material = material_named(config.material.name)
    estimator = estimator_from(config)
    reckons, kind = discrepancy_asked(config), uncertainty_asked(config)
    observation = observation_from(config, material)
    noise = noise_from(config)
    unknowns = unknowns_from(config, material, observation)
    laws, law_error = laws_for(config.law, material), known_law_error(law_folder(config.law, material))
    problem = EstimationProblem(laws, observation, unknowns, execution_from(config))
    finer = refined_problems(config, material, problem)

    guess = guess_from(config, material, problem)
    warn_of_sparse_particles([problem.start(guess)])
    module = InverseModule(problem, start_from_guess(config, problem, guess, console), estimator)
    folder = started_search(config, output)
    fit_inverse(module, folder, console)
    stages = [Stage(problem, module.u, module.linearisation())]
    if finer:
        stages += refined_estimate(finer, stages[0], console)
    found, fit = _judged(stages[-1], law_error, noise, reckons=reckons)
    seen = None
    if kind != LINEAR and not fit.has_intervals:
        console.print(f"uncertainty={kind}: there are no intervals, since the fit has none", markup=False)
    elif kind != LINEAR:
        found, seen = explored(config, stages[-1].problem, stages[-1].u, found, folder=folder)
    history = [
        *module.history,
        *((stage.problem.unknowns.values(stage.u).tolist(), stage.at.mse) for stage in stages[1:]),
    ]

    truth = stored_truth(observation, material.parameter_names)
    title = f"{material.name}, law {config.law}, {observation.name}: {observation.positions} positions"
    findings = Findings(title, unknowns, unknowns.values(guess).tolist(), found=found, fit=fit, truth=truth)
    console.print(result_table(findings))
    beside = [] if seen is None else seen.lines()
    for line in [*verdicts(found, fit), *beside, *_outside(config, material, stages[-1])]:
        console.print(line, markup=False)
    values = {
        "material": material.name,
        "law": config.law,
        "observation": str(config.observation.file),
        "estimator": estimator.name,
        **result_values(findings, beside),
        **({} if observation.registration is None else {"registration": dict(observation.registration)}),
        "mse": stages[-1].at.mse,
        "iterations": module.iterations,
        **({} if seen is None else {"uncertainty": {"kind": kind, **seen.values()}}),
        "history": [{"values": list(numbers), "mse": error} for numbers, error in history],
        "seconds": round(time.monotonic() - started, 1),
        "guards": counts(),
        "provenance": provenance(config.seed) | {"precision": config.precision},
    }
    for path in [
        *_extras(config, output, stages[-1], findings, history),
        *_explored_files(config, output, findings, seen),
    ]:
        console.print(f"wrote {path}")
    write_metrics(output, values)
    log_intervals(folder, found.estimates, module.iterations, fit.has_intervals)
    shutil.rmtree(folder / "checkpoints", ignore_errors=True)
    console.print(f"wrote {output}: MSE {stages[-1].at.mse:.2e} m^2 in {values['seconds']:g} s")
    return _numbers(values)


def _judged(last: Stage, law_error: float, noise: float | None, *, reckons: bool) -> tuple[Uncertainty, Fit]:
    """The uncertainty of the last estimate, and what is left of the motion."""
    problem, u, at, doubt = last.problem, last.u, last.weighted, last.doubt
    found = uncertainty(at, problem.unknowns, u, law_error, noise, doubt=doubt)
    left = found.residual if last.weight is None else found.residual / last.weight
    fit = fit_of(problem, u, replace(found, residual=left), noise)
    if reckons and (fit.fitted is False or is_pattern(problem.observation, found.residual)):
        fit = replace(fit, discrepancy=discrepancy_of(problem.observation, found.residual))
        found = uncertainty(at, problem.unknowns, u, law_error, noise, discrepancy=fit.discrepancy, doubt=doubt)
    return found, fit


def _numbers(values: Mapping[str, Any]) -> Mapping[str, float | None]:
    """What a sweep shows of a result."""
    found = {name: one["estimate"] for name, one in values["parameters"].items()}
    residual, scatter = values["fit"]["residual"], values["fit"]["scatter"]
    return {**found, "MSE [m^2]": values["mse"], "residual / scatter": residual / scatter if scatter else None}


def _outside(config: EstimateConfig, material: Material, last: Stage) -> list[str]:
    """A warning where the estimate lies outside of what the law was trained on: its error is not known there."""
    folder = law_folder(config.law, material)
    if folder is None:
        return []
    unknowns = last.problem.unknowns
    values = zip(unknowns.sought, unknowns.values(last.u).tolist(), strict=True)
    estimates = [{unknown.name: value} for unknown, value in values]
    warning = outside_training_data(load_run(folder).ranges, estimates)
    return [f"law={config.law}: {warning}; the interval knows nothing of the law's error there"] if warning else []


def _extras(
    config: EstimateConfig, output: Path, last: Stage, findings: Findings, history: Sequence[tuple[list[float], float]]
) -> list[Path]:
    """Pictures and the simulated trajectory, as far as they are asked for."""
    problem, u, observation = last.problem, last.u, last.problem.observation
    stem = _stem(output)
    written = []
    if config.trajectory:
        path = stem.with_name(f"{stem.name}_simulated.h5")
        _write_trajectory(path, problem, u)
        written.append(path)
    if config.picture:
        sought = tuple(unknown.name for unknown in problem.unknowns.sought)
        findings = replace(findings, truth=stored_truth(observation, sought))
        written += leave_estimation_pictures(stem, findings, observation, problem.beside(u), history)
    return written


def _explored_files(config: EstimateConfig, output: Path, findings: Findings, seen: Explored | None) -> list[Path]:
    if seen is None:
        return []
    return leave_explored(_stem(output), seen, findings.truth, findings.title, config.picture)


def _stem(output: Path) -> Path:
    return output.with_suffix("") if output.suffix else output


def _write_trajectory(path: Path, problem: EstimationProblem, u: np.ndarray) -> None:
    """The body's motion with the estimate, all particles of it."""
    observation = problem.observation
    steps = int(np.ceil(observation.time[-1] / observation.settings.time_step - 1e-6))
    plan = FramePlan(max(steps, 1), max(steps // 100, 1), velocities=True)
    write_scenes(path, simulate_records([problem.start(u)], problem.laws, plan, Execution(problem.execution.dtype)))
