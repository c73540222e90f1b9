"""The start of a scene that a program makes: checked, with the parts that carry no derivatives."""

from collections.abc import Mapping
from dataclasses import replace

from torch import Tensor

from pcnclaws.geometry.body import Body
from pcnclaws.interface.given import number
from pcnclaws.laws.materials import Material
from pcnclaws.mpm.settings import SimulationSettings
from pcnclaws.simulation.placement import require_inside, require_loaded, require_volume
from pcnclaws.simulation.scenes import SceneStart
from pcnclaws.simulation.time_step import stability_of


def checked_start(
    body: Body,
    material: Material,
    settings: SimulationSettings,
    values: Mapping[str, float | Tensor],
    *,
    name: str,
    velocity: Tensor,
    affine: Tensor,
    is_automatic: bool,
) -> SceneStart:
    """The scene's start, of numbers and arrays.

    values        physical parameters by name
    velocity      of the particles [m/s], (particles, 3)
    affine        APIC's C [1/s], (particles, 3, 3)
    is_automatic  whether the time step follows from the scene
    raises        UserError for a body outside of the domain or in a collider, and a load that acts on nothing
    """
    cloud, what = body.cloud, f"body '{body.name}'"
    require_volume(cloud.volume, settings, what)
    require_inside(cloud.position, settings, what)
    require_loaded(cloud.position, settings, what)
    varying = {
        one: value.detach().double().cpu().numpy()
        for one, value in values.items()
        if isinstance(value, Tensor) and value.dim()
    }
    turning = affine.detach().numpy()
    start = SceneStart(
        name,
        material.name,
        settings,
        {one: number(value) for one, value in values.items() if one not in varying},
        position=cloud.position,
        velocity=velocity.detach().numpy(),
        volume=cloud.volume,
        affine=turning if turning.any() else None,
        density=cloud.density,
        varying=varying,
    )
    if not is_automatic:
        return start
    return replace(start, settings=replace(settings, time_step=stability_of(start, material).automatic_time_step))
