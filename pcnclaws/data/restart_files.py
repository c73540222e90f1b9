"""Restarts from trajectory files: the state of a frame, and what a run that goes on from it does differently."""

import logging
from collections.abc import Mapping
from dataclasses import dataclass, fields, replace
from pathlib import Path

import numpy as np
from jaxtyping import Float

from pcnclaws.data.point_files import read_one_scene
from pcnclaws.errors import UserError
from pcnclaws.mpm.colliders import Collider
from pcnclaws.mpm.distance_fields import SignedDistance
from pcnclaws.mpm.loads import Load
from pcnclaws.mpm.settings import SimulationSettings
from pcnclaws.simulation.placement import require_inside, require_loaded
from pcnclaws.simulation.records import SceneRecord
from pcnclaws.simulation.restart import restart_of
from pcnclaws.simulation.scenes import SceneStart

log = logging.getLogger(__name__)

TRAJECTORIES = (".h5", ".hdf5")
SURROUNDINGS = ("colliders", "loads")


@dataclass(frozen=True)
class Restart:
    """A recorded scene and the restart state of one of its frames.

    record  with the settings and parameters that the state belongs to
    state   position, velocity, C, F, internal variables
    option  what names the frame, for messages
    """

    record: SceneRecord
    state: SceneStart
    option: str

    @property
    def time_step(self) -> float:
        """Of the recording [s]."""
        return self.record.settings.time_step

    @property
    def start_time(self) -> float:
        """At which the state is reached, by which colliders move and loads act [s]."""
        steps = 0 if self.state.fall is None else self.state.fall.steps
        return self.record.settings.time_at(steps)

    def going_on(
        self, material: str, parameters: Mapping[str, float], settings: SimulationSettings, with_time: bool = True
    ) -> SceneStart:
        """The scene that goes on from the state; one line names what differs from the recording.

        with_time  the settings' start time becomes that of the state
        """
        state, where = self.state, f"{self.option} of {self.record.label}"
        if with_time:
            settings = replace(settings, start_time=self.start_time if settings.changes else 0.0)
        different = _differences(self.record, material, parameters, settings)
        if different:
            log.warning("%s goes on otherwise than it was recorded: %s", where, ", ".join(different))
        # a body may have been pressed into walls and colliders
        require_inside(state.position, settings, where, slack=float("inf"))
        loaded_at = (state.loaded_at if state.loaded_at is not None else self.first) if settings.loads else None
        require_loaded(state.position if loaded_at is None else loaded_at, settings, where)
        return replace(state, material=material, parameters=parameters, settings=settings, loaded_at=loaded_at)

    @property
    def first(self) -> Float[np.ndarray, "particles 3"]:
        """Positions at the start of the recording [m], by which loads act on particles."""
        return self.record.position[0] if self.record.loaded_at is None else self.record.loaded_at


def read_restart(path: str | Path, name: str | None, frame: object, option: str = "scene.frame") -> Restart:
    """The restart state of a frame of a trajectory file.

    name    of a scene, where the file holds several
    frame   counted from the end where it is negative
    option  what the caller calls the frame, for messages
    raises  UserError, one line, for whatever is wrong with the file, and for a frame without restart state
    """
    if Path(path).suffix.lower() not in TRAJECTORIES:
        raise UserError(f"{path} is no trajectory file; accepted: a file ending in {', '.join(TRAJECTORIES)}")
    return restart(read_one_scene(Path(path), name), frame, option)


def restart(record: SceneRecord, frame: object, option: str) -> Restart:
    """As read_restart, of a recorded scene."""
    return Restart(record, restart_of(record, frame, option), f"{option}={frame}")


def _differences(
    record: SceneRecord, material: str, parameters: Mapping[str, float], settings: SimulationSettings
) -> list[str]:
    """What a run has otherwise than a recording, in words."""
    then = {"material": record.material} | {f"parameters.{name}": value for name, value in record.parameters.items()}
    now = {"material": material} | {f"parameters.{name}": value for name, value in parameters.items()}
    plain = [one.name for one in fields(settings) if one.name not in (*SURROUNDINGS, "start_time")]
    then |= {f"simulation.{name}": getattr(record.settings, name) for name in plain}
    now |= {f"simulation.{name}": getattr(settings, name) for name in plain}
    found = [f"{name}={now[name]} instead of {then[name]}" for name in then if name in now and now[name] != then[name]]
    for name in SURROUNDINGS:
        before, after = ([_described(thing) for thing in getattr(of, name)] for of in (record.settings, settings))
        if before != after:
            found.append(f"other scene.{name}")
    return found


def _described(thing: Collider | Load) -> object:
    """A value that is equal for equal colliders or loads; arrays as files hold them, functions by themselves."""
    if isinstance(thing, Collider) and isinstance(thing.shape, SignedDistance):
        return thing
    options = thing.to_options()
    return {
        name: value.astype(np.float32).tobytes() if isinstance(value, np.ndarray) else value
        for name, value in options.items()
    }
