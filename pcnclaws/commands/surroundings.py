"""From options to what stands around a body: the domain, its grid, colliders and loads."""

from collections.abc import Callable, Mapping
from functools import partial
from typing import Any, TypeVar

from pcnclaws.commands.typed_groups import Scene, ScenesSettings
from pcnclaws.errors import UserError
from pcnclaws.mpm.colliders import Collider
from pcnclaws.mpm.loads import Load
from pcnclaws.mpm.settings import Domain

Thing = TypeVar("Thing", Collider, Load)


def domain_of(value: Any) -> Domain | None:
    """The domain of simulation.domain, two corners [m]; None for null, without bounds."""
    if value is None:
        return None
    low, high = (tuple(float(x) for x in corner) for corner in value)
    return (low[0], low[1], low[2]), (high[0], high[1], high[2])


def grid_spacing_from(simulation: ScenesSettings) -> float | None:
    """The grid spacing of simulation.grid_nodes, cells along an edge of the unit box [m]; None where it is null."""
    nodes = simulation.grid_nodes
    if nodes is None:
        return None
    if isinstance(nodes, bool) or not isinstance(nodes, int) or nodes < 4:
        raise UserError(f"simulation.grid_nodes={nodes} is out of range; accepted: a whole number from 4, or null")
    if simulation.domain is not None and domain_of(simulation.domain) != ((0.0,) * 3, (1.0,) * 3):
        raise UserError(
            f"simulation.grid_nodes={nodes} counts cells of the unit box; accepted beside simulation.domain: "
            "simulation.grid_spacing"
        )
    return 1.0 / nodes


def surroundings_from(scene: Scene) -> dict[str, Any]:
    """The colliders, the loads and the start time of `scene.*`, by name; without those that are null."""
    found: dict[str, Any] = {}
    if scene.colliders is not None:
        found["colliders"] = tuple(
            _all_of(scene.colliders, "colliders", partial(Collider.from_options, opens_files=True))
        )
    if scene.loads is not None:
        found["loads"] = tuple(_all_of(scene.loads, "loads", Load.from_options))
    if scene.start_time is not None:
        found["start_time"] = scene.start_time
    return found


def _all_of(things: Any, name: str, make: Callable[[Mapping[str, Any], str], Thing]) -> list[Thing]:
    if not isinstance(things, list) or not all(isinstance(thing, dict) for thing in things):
        raise UserError(f"scene.{name}={things} is not accepted; accepted: a list of options in braces, [{{...}}, ...]")
    return [make(thing, f"scene.{name}[{number}]") for number, thing in enumerate(things)]
