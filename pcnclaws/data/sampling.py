"""Sampling plan of a data set: physical parameters and motions, a pure function of the plan."""

import math
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
from scipy.stats import qmc

from pcnclaws.data.reference_objects import is_near_reference
from pcnclaws.errors import UserError
from pcnclaws.geometry.shapes import PointCloud, particles, spin_velocity
from pcnclaws.laws.materials import Kind, Material
from pcnclaws.mpm.settings import SimulationSettings
from pcnclaws.simulation.placement import require_inside
from pcnclaws.simulation.scenes import SceneStart

SPLITS = ("train", "validation", "test")
MAXIMUM_SPEED, MAXIMUM_SPIN = 3.0, 4.0
MAXIMUM_SCENES = 10_000
FASTEST = 100.0
# Digits of the sampled parameters: enough to fill the ranges, few enough to be typed again.
DIGITS = 4


class Motion(NamedTuple):
    """How a body starts to move: velocity [m/s] and spin about its centre [rad/s], each (3,)."""

    velocity: np.ndarray
    spin: np.ndarray


# The test objects move the same whatever the seed, so that results can be compared: each hits the floor or a wall
# well within the first 100 steps, one of them spins.
TEST_MOTIONS = (
    Motion(np.array((1.0, -1.5, -2.0)), np.array((2.0, 2.0, 2.0))),
    Motion(np.array((1.0, -1.5, -1.5)), np.zeros(3)),
    Motion(np.array((-0.5, -2.5, 1.0)), np.zeros(3)),
)


@dataclass(frozen=True)
class DataSetPlan:
    """All that decides what a data set holds.

    body            the body of every scene; the velocities of its particles are drawn, not taken from it
    steps           length of each trajectory
    every           steps between frames
    keyframe_every  steps between full states, a multiple of `every`
    precision       'float32' or 'float64', of the simulation and of the files
    speed           up to which bodies are thrown [m/s], of all scenes but the test's
    spin            up to which half of them spin [rad/s]
    raises          UserError for a plan that cannot be made
    """

    material: Material
    settings: SimulationSettings = field(default_factory=SimulationSettings)
    body: PointCloud = field(default_factory=particles)
    steps: int = 500
    every: int = 5
    keyframe_every: int = 20
    train_scenes: int = 12
    validation_scenes: int = 2
    seed: int = 0
    precision: str = "float32"
    speed: float = MAXIMUM_SPEED
    spin: float = MAXIMUM_SPIN

    def __post_init__(self) -> None:
        _require_whole("simulation.steps", self.steps, 1)
        _require_whole("data.every", self.every, 1, self.steps)
        _require_whole("data.keyframe_every", self.keyframe_every, 1, self.steps)
        _require_whole("data.train_scenes", self.train_scenes, 1, MAXIMUM_SCENES)
        _require_whole("data.validation_scenes", self.validation_scenes, 1, MAXIMUM_SCENES)
        _require_whole("data.seed", self.seed, 0)
        for option, value in (("data.speed", self.speed), ("data.spin", self.spin)):
            if not 0.0 <= value <= FASTEST:
                raise UserError(f"{option}={value} is not accepted; accepted: a number from 0 to {FASTEST:g}")
        if self.precision not in ("float32", "float64"):
            raise UserError(f"precision={self.precision} is not accepted; accepted: float32, float64")
        if self.keyframe_every % self.every:
            raise UserError(
                f"data.keyframe_every={self.keyframe_every} is not accepted; "
                f"accepted: a multiple of data.every={self.every}"
            )
        require_inside(self.body.position, self.settings, "scene")


def planned_scenes(plan: DataSetPlan) -> dict[str, list[SceneStart]]:
    """The scenes of the data set by split.

    Training and validation parameters are scrambled Halton samples of the material's ranges that leave out the
    neighbourhoods of the reference objects; the test scenes are these objects.
    """
    return {
        "train": _sampled(plan, "train", plan.train_scenes, (plan.seed, 0)),
        "validation": _sampled(plan, "validation", plan.validation_scenes, (plan.seed, 1)),
        "test": [
            _start(plan, thing.name, dict(thing.parameters), TEST_MOTIONS[number % len(TEST_MOTIONS)])
            for number, thing in enumerate(plan.material.objects)
        ],
    }


def draw_parameters(material: Material, count: int, seed: tuple[int, ...]) -> list[dict[str, float]]:
    """Parameters from the material's ranges, none of them near a reference object.

    Of a material that holds several kinds of body, one kind after the other, each from its own ranges: as many as there
    would be of a material of this kind alone are the same.
    """
    kinds = material.kinds or (Kind(material.ranges, {}),)
    rounds = -(-count // len(kinds))
    drawn = [_of_kind(kind, material, rounds, seed) for kind in kinds]
    return [drawn[number % len(kinds)][number // len(kinds)] for number in range(count)]


def _of_kind(kind: Kind, material: Material, count: int, seed: tuple[int, ...]) -> list[dict[str, float]]:
    random = np.random.default_rng((*seed, 0))
    sample = qmc.Halton(len(kind.ranges), rng=random)
    lower, upper = np.array(list(kind.ranges.values())).T
    drawn: list[dict[str, float]] = []
    while len(drawn) < count:
        point = lower + (upper - lower) * sample.random(1)[0]
        own = {name: float(f"{value:.{DIGITS}g}") for name, value in zip(kind.ranges, point, strict=True)}
        parameters = {name: {**own, **kind.fixed}[name] for name in material.ranges}
        if not is_near_reference(parameters, material):
            drawn.append(parameters)
    return drawn


def draw_motions(
    count: int, seed: tuple[int, ...], largest_speed: float = MAXIMUM_SPEED, largest_spin: float = MAXIMUM_SPIN
) -> list[Motion]:
    """Motions: speeds up to the largest [m/s] in any direction that does not rise, half of them with spin.

    Spins go up to the largest [rad/s] about any axis. Which scenes spin is drawn apart from everything else.
    """
    random = np.random.default_rng((*seed, 1))
    sample = qmc.Halton(6, rng=random).random(count)
    spinning = random.permutation(count) < count // 2
    motions = []
    for (speed, azimuth, height, rate, spin_azimuth, spin_height), spins in zip(sample, spinning, strict=True):
        velocity = largest_speed * speed * _direction(azimuth, -height)
        spin = largest_spin * rate * _direction(spin_azimuth, 2.0 * spin_height - 1.0)
        motions.append(Motion(velocity, spin if spins else np.zeros(3)))
    return motions


def _direction(azimuth: float, height: float) -> np.ndarray:
    """The unit vector with the component `height` along y, and an azimuth from 0 to 1 around y."""
    radius, angle = math.sqrt(1.0 - height**2), 2.0 * math.pi * azimuth
    return np.array((radius * math.cos(angle), height, radius * math.sin(angle)))


def _sampled(plan: DataSetPlan, split: str, count: int, seed: tuple[int, ...]) -> list[SceneStart]:
    width = max(2, len(str(count - 1)))
    motions = draw_motions(count, seed, plan.speed, plan.spin)
    drawn = zip(draw_parameters(plan.material, count, seed), motions, strict=True)
    return [
        _start(plan, f"{split}-{number:0{width}d}", parameters, motion)
        for number, (parameters, motion) in enumerate(drawn)
    ]


def _start(plan: DataSetPlan, name: str, parameters: dict[str, float], motion: Motion) -> SceneStart:
    position = plan.body.position
    velocity = spin_velocity(position, np.broadcast_to(motion.velocity, position.shape), motion.spin.tolist())
    return SceneStart(
        name,
        plan.material.name,
        plan.settings,
        parameters,
        position=position,
        velocity=velocity,
        volume=plan.body.volume,
        density=plan.body.density,
    )


def _require_whole(option: str, value: int, lowest: int, highest: int | None = None) -> None:
    if isinstance(value, bool) or not isinstance(value, int) or value < lowest or (highest and value > highest):
        accepted = f"from {lowest}" + (f" to {highest}" if highest else "")
        raise UserError(f"{option}={value} is not accepted; accepted: a whole number {accepted}")
