"""Initial states of training segments: restart states, or the initial condition where the data hold none."""

from collections.abc import Sequence
from dataclasses import replace
from functools import reduce
from operator import getitem

from pcnclaws.commands.composition import stated_options, whole_file_options
from pcnclaws.commands.configuration import whole_number
from pcnclaws.commands.options import leaves
from pcnclaws.commands.typed import plain, typed
from pcnclaws.commands.typed_configs import TrainConfig
from pcnclaws.commands.typed_groups import Training
from pcnclaws.errors import UserError
from pcnclaws.simulation.motion import SceneSimulator
from pcnclaws.simulation.records import SceneRecord
from pcnclaws.training.sources import can_restart

GROUP, WITHOUT_KEYFRAMES = "training", "initial"


def settled_start(
    config: TrainConfig, model: SceneSimulator, scenes: Sequence[SceneRecord] | None
) -> tuple[TrainConfig, tuple[str, ...]]:
    """The configuration with the start that the data allow, and a line for the user where that is another one.

    Where there are no keyframes to start from, the settings are those of training=initial but for those that the user
    states: 20 steps from the start of a scene, most of them in free fall, would teach nothing.

    scenes  the user's own training scenes, None for the generated ones
    raises  UserError where the user states that segments start from keyframes
    """
    if model.one_step is not None or config.training.start != "keyframes":
        return config, ()
    reason = _no_keyframes(scenes) if scenes is not None else _no_keyframes_made(config)
    if reason is None:
        return config, ()
    stated, others = stated_options(GROUP), whole_file_options(GROUP, WITHOUT_KEYFRAMES)
    now = dict(leaves(plain(config.training)))
    settings = {
        option: value
        for option, value in others.items()
        if value != now.get(option) and not any(option == name or option.startswith(f"{name}.") for name in stated)
    }
    if "start" not in settings:
        raise UserError(
            f"training.start=keyframes is not accepted: {reason}; accepted: training=initial, for positions only"
        )
    training = plain(config.training)
    for option, value in settings.items():
        *groups, name = option.split(".")
        reduce(getitem, groups, training)[name] = value
    settled = replace(config, training=typed(Training, training))
    shown = ", ".join(f"training.{option}={value}" for option, value in settings.items())
    return settled, (f"trains on positions only, since {reason}: {shown}, as in training=initial",)


def _no_keyframes(scenes: Sequence[SceneRecord]) -> str | None:
    """That scenes of the user's hold no full states to start from; None if all of them do."""
    lacking = [scene for scene in scenes if not can_restart(scene)]
    if not lacking:
        return None
    which = "no scene" if len(lacking) == len(scenes) else f"not every scene ({lacking[0].label} is the first without)"
    return f"{which} has keyframes after its start"


def _no_keyframes_made(config: TrainConfig) -> str | None:
    """The same of scenes that are generated."""
    every, steps = (
        whole_number(config.data.keyframe_every, "data.keyframe_every"),
        whole_number(config.simulation.steps, "simulation.steps"),
    )
    return None if every < steps else f"data.keyframe_every={every} leaves none within simulation.steps={steps}"
