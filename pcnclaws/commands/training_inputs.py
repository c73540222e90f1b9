"""What a training begins with: its model, its scenes, and the options as the data settle them."""

from pathlib import Path
from typing import NamedTuple

import torch

from pcnclaws.commands.configuration import device_from, precision_from, whole_number
from pcnclaws.commands.data_sets import ready_data_set
from pcnclaws.commands.initial_weights import beside_initial_data, initial_run, set_initial_weights, with_model_of
from pcnclaws.commands.models import build_model
from pcnclaws.commands.runs import LoadedRun
from pcnclaws.commands.training_setup import regime_from
from pcnclaws.commands.training_start import settled_start
from pcnclaws.commands.typed_configs import TrainConfig
from pcnclaws.errors import UserError
from pcnclaws.laws.materials import material_named
from pcnclaws.simulation.motion import SceneSimulator
from pcnclaws.training.sources import TrainingScenes, for_regime, generated_scenes, own_scenes


class Inputs(NamedTuple):
    """What is there before any data is made.

    config   with the model of the initial law and the start that the data allow
    initial  the run whose weights the model has, None for random ones
    own      the user's scenes, None where they are generated
    notes    for the user, one line each
    """

    config: TrainConfig
    model: SceneSimulator
    initial: LoadedRun | None
    own: TrainingScenes | None
    notes: tuple[str, ...]


def inputs_of(config: TrainConfig) -> Inputs:
    """The model with its first weights, the user's scenes, and the options that follow from both; UserError."""
    initial = initial_run(config, material_named(config.material.name))
    config, model_notes = with_model_of(initial, config)
    regime, model = regime_from(config), untrained_model(config)
    if initial is not None:
        set_initial_weights(model, initial)
    own = None if config.data.trajectories is None else for_regime(_own_scenes(config), regime, config.regime.scene)
    config, start_notes = settled_start(config, model, own and own.training)
    return Inputs(config, model, initial, own, (*model_notes, *start_notes))


def scenes_of(inputs: Inputs) -> TrainingScenes:
    """The scenes of a training: the user's, or generated ones, which are made if they are missing."""
    config = inputs.config
    scenes = inputs.own or for_regime(_generated_scenes(config), regime_from(config), config.regime.scene)
    return scenes if inputs.initial is None else beside_initial_data(scenes, inputs.initial)


def untrained_model(config: TrainConfig) -> SceneSimulator:
    """The model of `material` and `model.*` as training with `seed` starts from it."""
    torch.manual_seed(whole_number(config.seed, "seed", least=0))
    untrained = build_model(material_named(config.material.name), config.model)
    return untrained.to(device_from(config.device), precision_from(config.precision))


def _own_scenes(config: TrainConfig) -> TrainingScenes:
    """The scenes of the user's own files."""
    named = config.data.trajectories
    paths = [named] if isinstance(named, str) else named
    if not isinstance(paths, list) or not paths or not all(isinstance(path, str) for path in paths):
        raise UserError(
            f"data.trajectories={named} is not accepted; accepted: the path of a trajectory file, or a list of them"
        )
    return own_scenes([Path(path) for path in paths], material_named(config.material.name))


def _generated_scenes(config: TrainConfig) -> TrainingScenes:
    """The scenes of the generated data set, which is made if it is missing."""
    return generated_scenes(ready_data_set(config), material_named(config.material.name))
