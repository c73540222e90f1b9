"""Tasks of the commands: a typed configuration in, one call of what does the work and loads PyTorch for it."""

from collections.abc import Mapping

from pcnclaws.commands.jobs import Task
from pcnclaws.commands.typed_configs import (
    CalibrateConfig,
    EstimateConfig,
    EvaluateConfig,
    ExportConfig,
    GenerateConfig,
    ObserveConfig,
    RenderConfig,
    SimulateConfig,
    TrainConfig,
)


def generate(config: GenerateConfig) -> None:
    """Makes what is missing of the data set in data.folder, and a picture of it."""
    from pcnclaws.commands import generation_command as work  # loads PyTorch

    work.generate(config)


def train(config: TrainConfig) -> Mapping[str, float | None]:
    """Makes the data if it is missing, trains, tests, and fills the run folder `output`; returns errors of the law."""
    from pcnclaws.commands import training_command as work  # loads PyTorch

    return work.train(config)


def simulate(config: SimulateConfig) -> None:
    """Writes the trajectory of the configured scene to `output`, and a picture of it beside it."""
    from pcnclaws.commands import simulation_command as work  # loads PyTorch

    work.simulate(config)


def evaluate(config: EvaluateConfig) -> Mapping[str, float | None]:
    """Writes the errors of the configured law on the configured task to `output`, and pictures; returns their means."""
    from pcnclaws.commands import evaluation_command as work  # loads PyTorch

    return work.evaluate(config)


def estimate(config: EstimateConfig) -> Mapping[str, float | None]:
    """Writes the parameters that explain the observation to `output`, with intervals; returns estimates and error."""
    from pcnclaws.commands import estimation_command as work  # loads PyTorch

    return work.estimate(config)


def observe(config: ObserveConfig) -> None:
    """Writes markers or points of a recorded motion to `output`, and a picture of them beside it."""
    from pcnclaws.commands import observation_command as work  # loads PyTorch

    work.observe(config)


def calibrate(config: CalibrateConfig) -> None:
    """Writes estimation.json, the error of the law in marker positions, beside its weights or to `output`."""
    from pcnclaws.commands import calibration_command as work  # loads PyTorch

    work.calibrate(config)


def render(config: RenderConfig) -> None:
    """Draws recorded motions: a sheet of their times (png, pdf, svg) or a film (gif, mp4), as `output` ends."""
    from pcnclaws.commands import render_command as work  # loads PyTorch

    work.render(config)


def export(config: ExportConfig) -> None:
    """Writes a motion for ParaView (vtu), Blender and Houdini (ply, usd) or programs (npz, csv), or a law alone."""
    from pcnclaws.commands import export_command as work  # loads PyTorch

    work.export(config)


TASKS: Mapping[str, Task] = {
    "generate": generate,
    "train": train,
    "simulate": simulate,
    "evaluate": evaluate,
    "estimate": estimate,
    "observe": observe,
    "calibrate": calibrate,
    "render": render,
    "export": export,
}
