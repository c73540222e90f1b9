"""What a comparison of run time and error goes through: the runs to make, from the options of the problem."""

from collections.abc import Mapping
from dataclasses import replace
from itertools import product
from typing import Any, NamedTuple

from benchmarks.checks import names, numbers, wholes
from benchmarks.closed_forms import CLOSED_FORMS
from benchmarks.floor_scenes import FLOOR_SCENES, NODES_STEP, FloorScene
from benchmarks.free_motions import FreeMotion
from benchmarks.timed_runs import PAPER, PAPER_NODES, Resolution
from pcnclaws.compiled.backend import BACKENDS
from pcnclaws.errors import UserError
from pcnclaws.laws.materials import MATERIALS
from pcnclaws.simulation.time_step import stability_of

LAWS = ("analytic", "neural")
PROBLEMS = (*FLOOR_SCENES, *CLOSED_FORMS)
ELASTIC = "elasticity"
# The settings of simulation=fast|balanced|accurate, which name the time step and the particles of a cube instead.
PRESETS = {
    "fast": Resolution(20, 1, 2.0),
    "balanced": Resolution(30, 1, 1.5),
    "accurate": Resolution(40, 1, 1.25),
}


class Trial(NamedTuple):
    """One run to make."""

    problem: str
    material: str
    law: str
    resolution: Resolution

    @property
    def series(self) -> tuple[str, str, str]:
        """What the trial shares with all others that it is compared with."""
        return self.problem, self.material, self.law

    @property
    def name(self) -> str:
        """In words, for the progress and the stored rows."""
        return f"{', '.join(self.series)}: {self.resolution.name}"

    @property
    def scenario(self) -> FloorScene | FreeMotion:
        """What is simulated."""
        if self.problem in FLOOR_SCENES:
            return FLOOR_SCENES[self.problem](self.material)
        return FreeMotion(self.problem, CLOSED_FORMS[self.problem])


def trials_of(options: Mapping[str, Any]) -> tuple[list[Trial], list[Trial]]:
    """The runs to make, and before them those that they are compared with; UserError for a wrong option."""
    resolutions, finest = _resolutions(options), _finest(options)
    floor = list(dict.fromkeys((*resolutions, *presets_of(options).values())))
    free = list(dict.fromkeys((*resolutions, *(replace(one, precision="float64") for one in resolutions))))
    trials, finer = [], []
    materials, laws = names(options, "materials", MATERIALS), names(options, "laws", LAWS)
    for material, law, problem in product(materials, laws, names(options, "problems", PROBLEMS)):
        if problem in FLOOR_SCENES:
            finer.append(Trial(problem, material, law, finest))
            for resolution in dict.fromkeys((*floor, *automatic_of(options, problem, material))):
                trials.append(Trial(problem, material, law, resolution))
        elif material == ELASTIC:
            trials += [Trial(problem, material, law, resolution) for resolution in free]
    return trials, finer


def _resolutions(options: Mapping[str, Any]) -> list[Resolution]:
    """Every grid, particle density and time step; at some grids also other precisions, implementations, no skips."""
    backend, per_cell = _backend(options), wholes(options, "per_cell", most=4)
    factors = numbers(options, "time_factors", 0.0)
    found = [
        Resolution(*one, backend=backend)
        for one in product(_nodes(options["grid_nodes"], "grid_nodes"), per_cell, factors)
    ]
    for one in product(_nodes(options["compare_at"], "compare_at"), per_cell):
        same = Resolution(*one, 1.0, backend=backend)
        found += [replace(same, precision="float64"), replace(same, skips=False), replace(same, backend="torch")]
    return list(dict.fromkeys(found))


def _finest(options: Mapping[str, Any]) -> Resolution:
    (nodes,) = _nodes([options["reference_nodes"]], "reference_nodes")
    (factor,) = numbers({"reference_factor": [options["reference_factor"]]}, "reference_factor", 0.0)
    return Resolution(nodes, max(wholes(options, "per_cell", most=4)), factor, backend=_backend(options))


def presets_of(options: Mapping[str, Any]) -> dict[str, Resolution]:
    """The settings of simulation=fast|balanced|accurate, where they are asked for."""
    chosen = PRESETS if options["presets"] else {}
    return {name: replace(resolution, backend=_backend(options)) for name, resolution in chosen.items()}


def automatic_of(options: Mapping[str, Any], problem: str, material: str) -> list[Resolution]:
    """simulation.time_step=auto on the grid of the paper, of a floor scene and with the presets; else nothing."""
    if not options["presets"] or problem not in FLOOR_SCENES:
        return []
    scenario, plain = FLOOR_SCENES[problem](material), Resolution(PAPER_NODES, 1, 1.0, backend=_backend(options))
    start = scenario.start(plain.lattice(scenario.box), plain)
    step = stability_of(replace(start, settings=PAPER)).automatic_time_step
    return [replace(plain, time_factor=step / PAPER.time_step)]


def _backend(options: Mapping[str, Any]) -> str:
    return names({"backend": [options["backend"]]}, "backend", BACKENDS)[0]


def _nodes(values: list[int], name: str) -> list[int]:
    for value in values:
        if value < NODES_STEP or value % NODES_STEP:
            raise UserError(f"problem.{name}: {value} is not accepted; accepted: multiples of {NODES_STEP}")
    return values
