"""Initial weights of a training: those of a trained law, which is fine-tuned, instead of random ones."""

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

from pcnclaws.commands.composition import stated_options
from pcnclaws.commands.runs import LoadedRun, load_run, shipped_folder
from pcnclaws.commands.typed_configs import TrainConfig
from pcnclaws.errors import UserError
from pcnclaws.laws.materials import Material
from pcnclaws.simulation.motion import SceneSimulator
from pcnclaws.training.sources import TrainingScenes
from pcnclaws.training.weights import model_weights, set_model_weights

OPTION = "training.init"


def initial_run(config: TrainConfig, material: Material) -> LoadedRun | None:
    """The run that training.init names, None for random weights.

    raises  UserError for what is no run, and for the law of another material
    """
    named = config.training.init
    if named is None:
        return None
    if not isinstance(named, str) or named in ("", "analytic"):
        raise UserError(
            f"{OPTION}={named} is not accepted; accepted: pretrained, the path of a run folder or of a packaged law, "
            "or null for random weights"
        )
    run = load_run(shipped_folder(material) if named == "pretrained" else Path(named), OPTION)
    if run.material.name != material.name:
        raise UserError(f"{OPTION}={named} was trained for material={run.material.name}, not {material.name}")
    return run


def with_model_of(run: LoadedRun | None, config: TrainConfig) -> tuple[TrainConfig, tuple[str, ...]]:
    """The configuration with the model of the run, and a line for the user where that is not the default one.

    raises  UserError where the user states another model
    """
    if run is None or run.config["model"] == dict(config.model):
        return config, ()
    if stated_options("model"):
        raise UserError(
            f"{OPTION}={config.training.init} has model={_shown(run.config['model'])}, not "
            f"{_shown(config.model)}; accepted: that model, which it has without being said"
        )
    line = f"model={_shown(run.config['model'])}, that of {OPTION}={config.training.init}"
    return replace(config, model=run.config["model"]), (line,)


def set_initial_weights(model: SceneSimulator, run: LoadedRun) -> None:
    """Loads the weights of a run into a model of the same configuration."""
    set_model_weights(model, model_weights(run.model), OPTION)


def beside_initial_data(scenes: TrainingScenes, run: LoadedRun) -> TrainingScenes:
    """The scenes with the ranges of a law that has seen the run's data, too."""
    spans = {
        name: (min(low, run.ranges[name][0]), max(high, run.ranges[name][1])) if name in run.ranges else (low, high)
        for name, (low, high) in scenes.ranges.items()
    }
    return replace(scenes, ranges=spans)


def _shown(model: Mapping[str, object]) -> str:
    fields = ", ".join(f"{name}={value}" for name, value in model.items() if name != "name")
    return f"{model.get('name')}{f' ({fields})' if fields else ''}"
