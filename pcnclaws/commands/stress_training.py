"""Training run on measured stress: loading paths, fit, and run folders that simulations take as laws."""

import re
import time
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import torch
from rich.console import Console

from pcnclaws.commands.configuration import use_processor, whole_number
from pcnclaws.commands.models import build_model
from pcnclaws.commands.outputs import check_ending
from pcnclaws.commands.runs import METRICS, WEIGHTS, is_finished, start_run
from pcnclaws.commands.stress_report import StressReport, write_stress_report
from pcnclaws.commands.stress_setup import StressData, stress_data
from pcnclaws.commands.typed import plain
from pcnclaws.commands.typed_configs import TrainConfig
from pcnclaws.errors import UserError
from pcnclaws.laws.materials import material_named
from pcnclaws.laws.stretch_energy import StretchEnergyNet
from pcnclaws.provenance import commit
from pcnclaws.simulation.motion import SceneSimulator
from pcnclaws.training.principal_paths import principal_paths
from pcnclaws.training.stress_fit import Specimen, StressFit, StressProblem, fit_stress
from pcnclaws.training.weights import model_weights, write_weights

# The network whose energy measured stress is fitted with.
MODEL = "pcnclaws_stretches"
# Poisson's ratios that an incompressible law may be simulated with.
NEARLY_INCOMPRESSIBLE = (0.4, 0.5)
SPECIMENS = "specimens"


def train_on_stress(config: TrainConfig) -> Mapping[str, float | None]:
    """Fits a law to the loading paths of `data.stress` and fills the run folder; returns the largest relative errors.

    Of several specimens each has a run folder of its own below it, with the one network and what tells it apart.
    """
    started = time.monotonic()
    commit()  # of the code that trains
    use_processor(config)
    check_ending("output", Path(config.output))
    whole_number(config.stress.iterations, "stress.iterations", least=0)
    console, folder, options = Console(soft_wrap=True), Path(config.output), plain(config)
    model, law = _untrained(config)
    data = stress_data(config)
    if not config.overwrite and is_finished(folder, options):
        console.print(f"{folder} holds this run, finished: see {folder / METRICS}; overwrite=true trains it anew")
        return {}
    for note in data.notes:
        console.print(note)
    start_run(folder, options, config.overwrite)
    paths = principal_paths(data.paths, data.specimens, data.is_incompressible)
    problem = StressProblem(law.double(), paths, data.specimens, data.poissons_ratio)
    fitted = fit_stress(problem, problem.start(config.seed), config.stress.iterations)
    folders = _write_runs(folder, options, (model, law), (data, fitted))
    report = StressReport(folder, data, paths, fitted, folders=folders, started=started)
    return write_stress_report(report, config.seed, config.picture, console)


def _untrained(config: TrainConfig) -> tuple[SceneSimulator, StretchEnergyNet]:
    material = material_named(config.material.name)
    if config.model.get("name") != MODEL or material.plastic is not None or len(material.parameter_names) != 2:
        raise UserError(
            f"data.stress with model={config.model.get('name')} and material={material.name} is not accepted; "
            f"accepted: model={MODEL} material=elasticity"
        )
    torch.manual_seed(whole_number(config.seed, "seed", least=0))
    model = build_model(material, config.model)
    laws = model.laws
    if laws is None or not isinstance(laws.elasticity, StretchEnergyNet):
        raise UserError(f"data.stress: model={MODEL} is another network than ours; accepted: ours")
    return model, laws.elasticity


def _write_runs(
    folder: Path,
    options: Mapping[str, Any],
    laws: tuple[SceneSimulator, StretchEnergyNet],
    found: tuple[StressData, StressFit],
) -> dict[str, Path]:
    """Writes the weights; returns the run folder of each specimen. Beside several, the top has those of the first."""
    (model, law), (data, fitted) = laws, found
    folders = {}
    for number, specimen in enumerate(fitted.specimens):
        fitted.put_into(law, number)
        model.float()
        own = folder if len(fitted.specimens) == 1 else folder / SPECIMENS / _folder_name(specimen.name)
        if own != folder:
            start_run(own, options)
        notes = _notes(specimen, data, fitted)
        write_weights(own / WEIGHTS, model_weights(model), notes)
        if number == 0 and own != folder:
            write_weights(folder / WEIGHTS, model_weights(model), notes)
        folders[specimen.name] = own
    return folders


def _notes(specimen: Specimen, data: StressData, fitted: StressFit) -> dict[str, Any]:
    ratio = data.poissons_ratio
    return {
        "material": "elasticity",
        "specimen": specimen.name,
        "ranges": {
            "youngs_modulus": [specimen.youngs_modulus] * 2,
            "poissons_ratio": list(NEARLY_INCOMPRESSIBLE) if data.is_incompressible else [ratio, ratio],
        },
        "iterations": len(fitted.history),
    }


def _folder_name(specimen: str) -> str:
    return re.sub(r"[^\w.-]+", "_", specimen)
