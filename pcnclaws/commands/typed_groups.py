"""Groups of options that commands share: one dataclass a group.

What an option means is said where it is written, in conf/.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, TypeAlias

Number: TypeAlias = float | int
Vector: TypeAlias = list[Number]
# An option whose default is null, which says nothing of its kind: whoever reads it checks it.
Unchecked: TypeAlias = Any


@dataclass(frozen=True)
class Paths:
    """`paths.*`."""

    outputs: str


@dataclass(frozen=True)
class Named:
    """A group whose choice is its name."""

    name: str


@dataclass(frozen=True)
class Scene:
    """`scene.*`: the body and how it starts."""

    shape: Unchecked
    centre: Vector
    side: Number
    particles_per_edge: int
    lattice: str
    mesh: Unchecked
    particles: Unchecked
    name: Unchecked
    velocity: Unchecked
    spin: Unchecked
    colliders: Unchecked
    loads: Unchecked
    affine: str
    start_time: Unchecked = None
    frame: Unchecked = None


@dataclass(frozen=True)
class Backend:
    """`simulation.backend`."""

    backend: str


@dataclass(frozen=True)
class Computation(Backend):
    """How simulations are computed."""

    skip: Mapping[str, bool]


@dataclass(frozen=True)
class FileSimulation(Computation):
    """`simulation.*` of scenes of a file, which bring their settings."""

    time_step: Unchecked


@dataclass(frozen=True)
class ScenesSettings(FileSimulation):
    """`simulation.*` that scenes are made with."""

    domain: Unchecked
    grid_spacing: Unchecked
    grid_nodes: Unchecked
    wall_distance: Unchecked
    gravity: Unchecked
    boundary: Unchecked
    friction: Unchecked
    density: Unchecked
    transfer: Unchecked


@dataclass(frozen=True)
class ObservedSimulation(ScenesSettings):
    """`simulation.*` of an observed scene: null is what the file says. Presets have steps, of which it needs none."""

    steps: Unchecked = None
    every: Unchecked = None


@dataclass(frozen=True)
class Simulation(ScenesSettings):
    """`simulation.*`."""

    steps: int
    every: int


@dataclass(frozen=True)
class Data:
    """`data.*`: a generated data set, or the user's own files."""

    folder: str
    trajectories: Unchecked
    stress: Unchecked
    train_scenes: int
    validation_scenes: int
    every: int
    keyframe_every: int
    seed: int
    speed: Number
    spin: Number


@dataclass(frozen=True)
class Regime(Named):
    """`regime.*`."""

    scene: Unchecked


@dataclass(frozen=True)
class SegmentLength:
    """`training.segment_length.*`."""

    first: Unchecked
    last: Unchecked


@dataclass(frozen=True)
class Training:
    """`training.*`."""

    start: str
    iterations: int
    batch_segments: Unchecked
    segment_length: SegmentLength
    loss: str
    loss_every: Unchecked
    loss_scale: Unchecked
    learning_rate: Number
    plastic_learning_rate: Unchecked
    gradient_clip: Unchecked
    step_back: Unchecked
    check_every: int
    seconds: Unchecked
    noise: Number | None = None
    method: str = "adam"
    init: Unchecked = None
    average: Unchecked = None


@dataclass(frozen=True)
class MeasuredStress:
    """`stress.*`: what the files of data.stress do not say, and how a law is fitted to them."""

    poissons_ratio: Unchecked
    specimens: Unchecked
    units: Unchecked
    reference: Unchecked
    weights: Unchecked
    leave_out: Unchecked
    iterations: int


@dataclass(frozen=True)
class EarlyStopping:
    """`callbacks.early_stopping.*`."""

    patience: Unchecked
    min_delta: Unchecked


@dataclass(frozen=True)
class Callbacks:
    """`callbacks.*`."""

    early_stopping: EarlyStopping


@dataclass(frozen=True)
class Logger(Named):
    """`logger.*`."""

    every: int
    project: str | None = None


@dataclass(frozen=True)
class Task(Named):
    """`task.*`."""

    scene: Unchecked = None


@dataclass(frozen=True)
class Observed:
    """`observation.*`."""

    file: Unchecked
    kind: str
    scene: Unchecked
    units: Unchecked
    frame: Unchecked
    start: Unchecked
    window: Unchecked
    noise: Unchecked


@dataclass(frozen=True)
class UnknownMotion:
    """`unknown.*`."""

    motion: bool | str
    time_offset: bool
    surface_offset: bool | str
    walls: bool
    friction: bool
    gravity: bool
    size: bool


@dataclass(frozen=True)
class Estimator(Named):
    """`estimator.*`."""

    iterations: int
    learning_rate: Number
