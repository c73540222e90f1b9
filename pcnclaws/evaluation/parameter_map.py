"""The map of parameters: scenes on lattices of two parameters each, far beyond the ranges of the training data."""

import math
from collections.abc import Iterator, Mapping
from dataclasses import replace
from itertools import combinations
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from pcnclaws.data.sampling import TEST_MOTIONS, DataSetPlan
from pcnclaws.geometry.shapes import spin_velocity
from pcnclaws.laws.materials import Material
from pcnclaws.laws.parameters import PARAMETERS
from pcnclaws.mpm.settings import SimulationSettings
from pcnclaws.rendering.maps import ErrorMap, MapAxis
from pcnclaws.simulation.scenes import SceneStart
from pcnclaws.simulation.time_step import COMFORTABLE_CFL, largest_speed, scene_cfl

POINTS = 6
DIGITS = 4


class MapPoint(NamedTuple):
    """One scene of the map: the two parameters that vary, where it lies on their axes, and all its parameters."""

    names: tuple[str, str]
    row: int
    column: int
    parameters: dict[str, float]

    @property
    def scene(self) -> str:
        """Name of its scene."""
        words = (f"{PARAMETERS[name].symbol.replace('_', '')}{_short(self.parameters[name])}" for name in self.names)
        return f"map-{'-'.join(words)}"


def map_axis(material: Material, name: str, points: int = POINTS) -> Float[np.ndarray, " points"]:
    """Values of a parameter from half the lower to twice the upper limit of its range, as far as the laws go."""
    low, high = material.ranges[name]
    parameter = PARAMETERS[name]
    least, most = parameter.plausible or (parameter.lower, parameter.upper)
    low, high = max(0.5 * low, least), min(2.0 * high, most)
    values = np.geomspace(low, high, points) if parameter.logarithmic else np.linspace(low, high, points)
    return np.array([float(f"{value:.{DIGITS}g}") for value in values])


def map_points(material: Material, points: int = POINTS) -> Iterator[MapPoint]:
    """The points of all pairs of parameters, row by row; the other parameters are the material's defaults."""
    for names in combinations(material.parameter_names, 2):
        across, up = (map_axis(material, name, points) for name in names)
        for row, high in enumerate(up.tolist()):
            for column, right in enumerate(across.tolist()):
                values = material.defaults | dict(zip(names, (right, high), strict=True))
                yield MapPoint(names, row, column, values)


def map_settings(material: Material, plan: DataSetPlan, points: int = POINTS) -> SimulationSettings:
    """The plan's settings, its time step divided by a whole number so that every scene stays below CFL number 0.4."""
    body, settings = plan.body, plan.settings
    speed = largest_speed(body.position, _velocity(plan), settings)
    highest = max(scene_cfl(settings, point.parameters, speed) for point in map_points(material, points))
    return replace(settings, time_step=settings.time_step / (math.floor(highest / COMFORTABLE_CFL) + 1))


def map_starts(
    material: Material, plan: DataSetPlan, settings: SimulationSettings, points: int = POINTS
) -> list[SceneStart]:
    """The scenes of the map: the plan's body, thrown like the first test object."""
    velocity = _velocity(plan)
    return [
        SceneStart(
            point.scene,
            material.name,
            settings,
            point.parameters,
            position=plan.body.position,
            velocity=velocity,
            volume=plan.body.volume,
        )
        for point in map_points(material, points)
    ]


def error_maps(material: Material, mse: Mapping[str, float | None], points: int = POINTS) -> list[ErrorMap]:
    """A map for each pair of parameters.

    mse  [m^2] by name of the scene, None for a scene that diverged
    """
    found: dict[tuple[str, str], np.ndarray] = {}
    for point in map_points(material, points):
        value = mse[point.scene]
        grid = found.setdefault(point.names, np.full((points, points), np.nan))
        grid[point.row, point.column] = np.nan if value is None else value
    axes = {
        name: MapAxis(name, map_axis(material, name, points), PARAMETERS[name].logarithmic, span)
        for name, span in material.ranges.items()
    }
    return [ErrorMap(axes[across], axes[up], grid) for (across, up), grid in found.items()]


def _short(value: float) -> str:
    """A number as a part of a name: 1.2e6, 0.308."""
    return f"{value:.{DIGITS}g}".replace("e+0", "e")


def _velocity(plan: DataSetPlan) -> Float[np.ndarray, "particles 3"]:
    motion, position = TEST_MOTIONS[0], plan.body.position
    return spin_velocity(position, np.broadcast_to(motion.velocity, position.shape), motion.spin.tolist())
