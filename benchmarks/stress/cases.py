"""The stressed scenes: one quantity of an ordinary scene at a time, to the edge of what it may be and beyond."""

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np
import torch

import pcnclaws as pc
from pcnclaws.simulation.scenes import SceneStart

MATERIALS = ("elasticity", "plasticine", "sand")
LAWS = ("analytic", "shipped")
NODES, STEPS, DROP = 20, 300, -2.0
DX = 1.0 / NODES
# One step of a hundred thousand particles is worth hundreds of a small scene.
MANY, FEW_STEPS = 100_000, 60
ROOM = pc.Settings(time_step="auto")
FLOOR = 3 * DX  # of the default wall layer


class StressCase(NamedTuple):
    """One scene with one quantity at the edge.

    axis    the quantity, in words; value  what it is here
    start   of the scene, given its law: what is refused is refused in here
    """

    material: str
    law: str
    axis: str
    value: str
    start: Callable[[pc.ConstitutiveModel], SceneStart]
    steps: int = STEPS
    dtype: torch.dtype = torch.float32

    @property
    def name(self) -> str:
        return f"{self.material}, {self.law}, {self.axis} {self.value}"


class Stressed(NamedTuple):
    """What a quantity is changed to: see StressCase."""

    value: str
    make: Callable[[pc.ConstitutiveModel], pc.Scene]
    steps: int = STEPS
    dtype: torch.dtype = torch.float32
    deformation: tuple[tuple[float, ...], ...] | None = None


def cases(materials: Sequence[str], laws: Sequence[str]) -> list[StressCase]:
    """All of them, in the order of the table."""
    return [
        StressCase(material, law, axis, one.value, _start(one), one.steps, one.dtype)
        for material in materials
        for law in laws
        for axis, stressed in _AXES.items()
        for one in stressed(material)
    ]


def law_of(material: str, law: str) -> pc.ConstitutiveModel:
    """The law of a case."""
    return pc.analytic_law(material) if law == "analytic" else pc.load_law(material)


def base_scene(law: pc.ConstitutiveModel, **changes: object) -> pc.Scene:
    """A cube of 512 particles that meets the floor at 2 m/s."""
    body = changes.pop("body", None) or pc.Body.cube(side=0.2, centre=(0.5, FLOOR + 0.11, 0.5), particles_per_edge=8)
    arguments = {"velocity": (0.0, DROP, 0.0), "settings": ROOM} | changes
    return pc.Scene(body, law, **arguments)  # pyright: ignore[reportArgumentType]


def _start(one: Stressed) -> Callable[[pc.ConstitutiveModel], SceneStart]:
    def start(law: pc.ConstitutiveModel) -> SceneStart:
        scene = one.make(law)
        scene._check_run()
        if one.deformation is None:
            return scene._start
        every = np.tile(np.array(one.deformation), (len(scene.body), 1, 1))
        return replace(scene._start, deformation=every)

    return start


def _time_steps(_: str) -> Iterator[Stressed]:
    for factor in (0.1, 0.25, 0.5, 0.9, 1.0, 1.1, 1.5, 2.0):

        def make(law: pc.ConstitutiveModel, factor: float = factor) -> pc.Scene:
            scene = base_scene(law)
            # a hair below the limit itself
            step = factor * scene.stable_time_step * (1.0 - 1e-9)
            return scene.with_(settings=pc.Settings(time_step=step))

        yield Stressed(f"{factor:g} of the limit", make)


def _moduli(_: str) -> Iterator[Stressed]:
    for modulus in (1e3, 1e4, 1e5, 1e6, 1e7):
        yield _parameter("youngs_modulus", modulus, f"{modulus:.0e} Pa")


def _ratios(_: str) -> Iterator[Stressed]:
    for ratio in (-0.5, -0.25, 0.0, 0.25, 0.4, 0.45, 0.49, 0.499):
        yield _parameter("poissons_ratio", ratio, f"{ratio:g}")


def _flows(material: str) -> Iterator[Stressed]:
    if material == "sand":
        for angle in (0.0, 1e-3, 15.0, 45.0, 60.0, 89.0):
            yield _parameter("friction_angle", angle, f"friction angle {angle:g} deg")
    if material == "plasticine":
        for stress in (0.0, 1e-3, 1e2, 1e5, 1e30, math.inf):
            yield _parameter("yield_stress", stress, f"yield stress {stress:g} Pa")


def _parameter(name: str, value: float, words: str) -> Stressed:
    return Stressed(words, lambda law: base_scene(law, **{name: value}))


def _impacts(_: str) -> Iterator[Stressed]:
    for speed in (0.5, 5.0, 10.0, 20.0, 30.0):
        yield Stressed(f"{speed:g} m/s", lambda law, speed=speed: base_scene(law, velocity=(0.3, -speed, 0.1)))


def _spins(_: str) -> Iterator[Stressed]:
    high = pc.Body.cube(side=0.2, centre=(0.5, 0.6, 0.5), particles_per_edge=8)
    for spin in (5.0, 30.0, 100.0):
        yield Stressed(
            f"{spin:g} rad/s", lambda law, spin=spin: base_scene(law, body=high, spin=(0.2 * spin, spin, 0.1 * spin))
        )


def _counts(_: str) -> Iterator[Stressed]:
    for per_edge in (1, 2, 3, 10):
        yield Stressed(f"{per_edge**3}", lambda law, n=per_edge: base_scene(law, body=_lattice((n, n, n), 0.5 * DX)))
    edge = round(MANY ** (1 / 3)) + 1
    yield Stressed(f"{edge**3}", lambda law: base_scene(law, body=_lattice((edge,) * 3, 0.6 / edge)), FEW_STEPS)


def _lattice(counts: tuple[int, int, int], spacing: float, low: tuple[float, ...] | None = None) -> pc.Body:
    """A lattice of particles, in the middle above the floor unless its low corner is given [m]."""
    axes = [spacing * (np.arange(count) + 0.5) for count in counts]
    where = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3)
    if low is None:
        low = (0.5 - 0.5 * spacing * counts[0], FLOOR + 0.01, 0.5 - 0.5 * spacing * counts[2])
    return pc.Body.points(where + np.array(low), volume=spacing**3)


def _places(_: str) -> Iterator[Stressed]:
    half = 0.5 * DX
    twins = np.tile([[0.51, FLOOR + 0.02, 0.49]], (2, 1))
    node = np.array([[0.5, 0.3, 0.5]])
    bodies = {
        "one particle on a node": lambda: pc.Body.points(node, volume=half**3),
        "two in the same place": lambda: pc.Body.points(twins, volume=half**3),
        "one a cell": lambda: _lattice((5, 5, 5), DX),
        "64 a cell": lambda: _lattice((12, 12, 12), 0.25 * DX),
        "one in two cells": lambda: _lattice((4, 4, 4), 1.26 * DX),
        "in a corner of the room": lambda: _lattice((6, 6, 6), half, (FLOOR, FLOOR, FLOOR)),
        "a sheet of one layer": lambda: _lattice((12, 1, 12), half),
        "a sheet on edge": lambda: _lattice((1, 12, 12), half),
        "a rod": lambda: _lattice((1, 12, 1), half),
    }
    for words, body in bodies.items():
        yield Stressed(words, lambda law, body=body: base_scene(law, body=body()))


def _deformations(_: str) -> Iterator[Stressed]:
    starts = {
        "all sides to a tenth, det F 1e-3": ((0.1, 0, 0), (0, 0.1, 0), (0, 0, 0.1)),
        "one side to a tenth": ((1, 0, 0), (0, 0.1, 0), (0, 0, 1)),
        "one side to a thousandth": ((1, 0, 0), (0, 1e-3, 0), (0, 0, 1)),
        "one side tenfold": ((1, 0, 0), (0, 10.0, 0), (0, 0, 1)),
        "sheared by 5": ((1, 5.0, 0), (0, 1, 0), (0, 0, 1)),
    }
    for words, deformation in starts.items():
        yield Stressed(words, base_scene, deformation=deformation)


def _gravities(_: str) -> Iterator[Stressed]:
    for factor in (0.0, 1.0, 10.0):
        settings = pc.Settings(time_step="auto", gravity=(0.0, -9.8 * factor, 0.0))
        yield Stressed(f"{factor:g} times the Earth's", lambda law, room=settings: base_scene(law, settings=room))


def _precisions(_: str) -> Iterator[Stressed]:
    for dtype in (torch.float32, torch.float64):
        yield Stressed(str(dtype).removeprefix("torch."), base_scene, dtype=dtype)


def _colliders(_: str) -> Iterator[Stressed]:
    below = FLOOR + 0.02
    tetrahedron = (
        torch.tensor(
            [[0.35, below - 0.1, 0.35], [0.65, below - 0.1, 0.35], [0.5, below - 0.1, 0.7], [0.5, below, 0.5]]
        ),
        torch.tensor([[0, 1, 2], [0, 3, 1], [1, 3, 2], [2, 3, 0]]),
    )
    high = pc.Body.cube(side=0.2, centre=(0.5, FLOOR + 0.16, 0.5), particles_per_edge=8)
    made = {
        "plane, separate, friction 0.5": lambda: pc.Collider.plane(
            (0.5, below, 0.5), (0.2, 1, 0.1), contact="separate", friction=0.5
        ),
        "plane, slip": lambda: pc.Collider.plane((0.5, below, 0.5), (0, 1, 0), contact="slip"),
        "plane, sticky": lambda: pc.Collider.plane((0.5, below, 0.5), (0, 1, 0), contact="sticky"),
        "sphere": lambda: pc.Collider.sphere((0.5, below - 0.1, 0.5), 0.1),
        "box on edge, turning": lambda: pc.Collider.box(
            (0.45, below - 0.1, 0.45), (0.55, below, 0.55), spin=(0, 20.0, 0), friction=0.5
        ),
        "capsule": lambda: pc.Collider.capsule((0.3, below - 0.05, 0.5), (0.7, below - 0.05, 0.5), 0.05),
        "cylinder": lambda: pc.Collider.cylinder((0.3, below - 0.05, 0.5), (0.7, below - 0.05, 0.5), 0.05),
        "mesh": lambda: pc.Collider.mesh(tetrahedron),
        "function": lambda: pc.Collider.signed_distance(lambda x, t: x[:, 1] - below + 0.1 * (x[:, 0] - 0.5) ** 2),
        "press to a tenth of the height": lambda: pc.Collider.box(
            (0.2, FLOOR + 0.27, 0.2), (0.8, FLOOR + 0.4, 0.8), velocity=(0, -2.5, 0), end=0.1
        ),
    }
    for words, collider in made.items():
        yield Stressed(words, lambda law, one=collider: base_scene(law, body=high, colliders=[one()]))


_AXES: dict[str, Callable[[str], Iterator[Stressed]]] = {
    "time step": _time_steps,
    "Young's modulus": _moduli,
    "Poisson's ratio": _ratios,
    "plastic flow": _flows,
    "impact": _impacts,
    "spin": _spins,
    "particles": _counts,
    "place": _places,
    "start deformed": _deformations,
    "gravity": _gravities,
    "precision": _precisions,
    "obstacle": _colliders,
}
AXES = tuple(_AXES)
