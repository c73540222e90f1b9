"""Finer grids of an estimation, from typed options: `refinements`."""

from dataclasses import replace

from rich.console import Console

from pcnclaws.commands.configuration import execution_from
from pcnclaws.commands.estimation_setup import refinements_from, unknowns_from
from pcnclaws.commands.observation_setup import observation_from
from pcnclaws.commands.typed_configs import EstimateConfig
from pcnclaws.errors import UserError
from pcnclaws.estimation.grid_spacing import most_alike
from pcnclaws.estimation.problem import EstimationProblem
from pcnclaws.estimation.refinement import Stage, refined
from pcnclaws.laws.materials import Material


def refined_problems(config: EstimateConfig, material: Material, coarse: EstimationProblem) -> list[EstimationProblem]:
    """The same observation and unknowns on finer grids: time step and distance of particles are as much smaller."""
    return [_problem(config, material, coarse, times) for times in refinements_from(config)]


def refined_estimate(problems: list[EstimationProblem], search: Stage, console: Console) -> list[Stage]:
    """The estimates on finer grids, and last the one at the spacing that the motion is most like, if there are two."""
    stages: list[Stage] = []
    for stage in refined(search, problems):
        stages.append(stage)
        settings = stage.problem.observation.settings
        console.print(f"grid spacing {settings.grid_spacing:.4g} m: {_words(stage)}", markup=False)
        if not stage.settled:
            console.print(
                "  the search on this grid did not come to its end: the numbers are those of its best simulation"
            )
    if len(stages) > 1:
        coarsest, coarse, fine = [search, *stages][-3:]
        stages.append(most_alike(coarsest, coarse, fine))
        console.print(f"between and beyond them: {_words(stages[-1])}", markup=False)
    return stages


def _problem(config: EstimateConfig, material: Material, coarse: EstimationProblem, times: float) -> EstimationProblem:
    scene, simulation, own = config.scene, config.simulation, coarse.observation.settings
    finer = replace(
        config,
        scene=replace(scene, particles_per_edge=round(scene.particles_per_edge * times)),
        simulation=replace(
            simulation,
            grid_nodes=None,
            grid_spacing=own.grid_spacing / times,
            time_step=own.time_step / times,
        ),
    )
    try:
        observation = observation_from(finer, material)
    except UserError as fault:
        raise UserError(f"refinements={config.refinements}: {fault}") from None
    return EstimationProblem(
        coarse.laws, observation, unknowns_from(finer, material, observation), execution_from(config)
    )


def _words(stage: Stage) -> str:
    values = stage.problem.unknowns.values(stage.u).tolist()
    named = zip(stage.problem.unknowns.sought, values, strict=True)
    sought = [f"{one.label} {value:.4g}" for one, value in named if not one.is_motion]
    return "  ".join([*sought, f"MSE {stage.at.mse:.2e} m²"])
