"""Configurations of the commands: one dataclass a command, of the parts that commands share.

What an option means is said where it is written, in conf/.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from pcnclaws.commands.typed_groups import (
    Backend,
    Callbacks,
    Computation,
    Data,
    Estimator,
    FileSimulation,
    Logger,
    MeasuredStress,
    Named,
    Number,
    Observed,
    ObservedSimulation,
    Paths,
    Regime,
    Scene,
    Simulation,
    Task,
    Training,
    Unchecked,
    UnknownMotion,
)


@dataclass(frozen=True)
class Command:
    """What every command has."""

    paths: Paths
    output: Unchecked


@dataclass(frozen=True)
class SimulatingCommand(Command):
    """What every command has that simulates."""

    plugins: list[str]
    material: Named
    simulation: Computation
    device: str
    precision: str
    threads: Unchecked


@dataclass(frozen=True)
class SimulateConfig(SimulatingCommand):
    """Options of `simulate`."""

    simulation: Simulation
    parameters: Mapping[str, Number]
    scene: Scene
    law: str
    keyframe_every: int
    picture: bool


@dataclass(frozen=True)
class GenerateConfig(SimulatingCommand):
    """Options of `generate`."""

    simulation: Simulation
    scene: Scene
    data: Data


@dataclass(frozen=True)
class TrainConfig(GenerateConfig):
    """Options of `train`."""

    model: Mapping[str, Any]
    regime: Regime
    training: Training
    stress: MeasuredStress
    trainer: Mapping[str, Unchecked]
    callbacks: Callbacks
    logger: Logger
    name: str
    overwrite: bool
    picture: bool
    seed: int


@dataclass(frozen=True)
class EvaluateConfig(SimulatingCommand):
    """Options of `evaluate`."""

    simulation: FileSimulation
    task: Task
    law: str
    trajectories: Unchecked
    picture: bool
    may_diverge: bool
    floor: bool
    seed: int


@dataclass(frozen=True)
class EstimateConfig(SimulatingCommand):
    """Options of `estimate`."""

    simulation: ObservedSimulation
    scene: Scene
    estimator: Estimator
    law: str
    observation: Observed
    initial_guess: Mapping[str, Unchecked]
    fixed: Mapping[str, Unchecked]
    vary: str
    unknown: UnknownMotion
    discrepancy: bool
    refinements: Unchecked
    uncertainty: str
    samples: int
    screening: int
    overwrite: bool
    picture: bool
    trajectory: bool
    seed: int


@dataclass(frozen=True)
class ObserveConfig(Command):
    """Options of `observe`."""

    file: Unchecked
    scene: Unchecked
    kind: str
    markers: Number
    surface: bool
    points: int
    camera: Unchecked
    every: int
    noise: Number
    missing: Number
    seed: int
    picture: bool


@dataclass(frozen=True)
class ExportConfig(Command):
    """Options of `export`."""

    plugins: list[str]
    trajectory: Unchecked
    scene: Unchecked
    format: Unchecked
    frame: Unchecked
    surface: bool
    law: Unchecked
    material: Mapping[str, str] | None = None


@dataclass(frozen=True)
class RenderConfig(Command):
    """Options of `render`."""

    plugins: list[str]
    trajectory: Unchecked
    scene: Unchecked
    names: Unchecked
    layout: str
    colour: str
    colour_map: str
    colour_range: Unchecked
    law: str
    renderer: str
    size: Unchecked
    oversample: Unchecked
    azimuth: Number
    elevation: Number
    zoom: Number
    times: int
    frame_rate: Number
    seconds: Unchecked


@dataclass(frozen=True)
class CalibrateConfig(Command):
    """Options of `calibrate`."""

    plugins: list[str]
    material: Named
    law: str
    objects: int
    seed: int
    simulation: Backend
    threads: Unchecked


@dataclass(frozen=True)
class BenchmarkConfig(Command):
    """Options of `python -m benchmarks`."""

    plugins: list[str]
    problem: Mapping[str, Any]
    redraw: Unchecked
    seed: int
    device: str
    threads: int


CONFIGS: Mapping[str, type[Command]] = {
    "simulate": SimulateConfig,
    "generate": GenerateConfig,
    "train": TrainConfig,
    "evaluate": EvaluateConfig,
    "estimate": EstimateConfig,
    "observe": ObserveConfig,
    "calibrate": CalibrateConfig,
    "export": ExportConfig,
    "render": RenderConfig,
    "benchmark": BenchmarkConfig,
}
