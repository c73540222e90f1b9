"""What a simulation gives back: the motion of a scene, particle-first."""

import logging
import tempfile
from collections.abc import Mapping
from pathlib import Path

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor

from pcnclaws.data.motion_files import FORMATS, write_motion
from pcnclaws.errors import UserError
from pcnclaws.laws.analytic import Laws
from pcnclaws.rendering.pictures import trajectory_picture
from pcnclaws.simulation.particle_fields import ParticleFields
from pcnclaws.simulation.records import SceneRecord

log = logging.getLogger(__name__)

PICTURES = (".png", ".pdf", ".svg")


class Motion:
    """The recorded motion of a scene, frame 0 the start; in the precision and on the device of the simulation.

    time         of the frames [s], (frames,), always double precision
    position     [m], (frames, particles, 3)
    velocity     [m/s], (frames, particles, 3)
    deformation  elastic deformation gradient F [-], (frames, particles, 3, 3), None unless it was asked for
    internal     internal variables of the law by name, each (frames, particles); none unless F was asked for
    impulses     of each collider on the body since the start [N s], (frames, colliders, 3), always double precision
    record       the same as NumPy arrays, with the settings and parameters of the scene
    """

    time: Float[Tensor, " frames"]
    position: Float[Tensor, "frames particles 3"]
    velocity: Float[Tensor, "frames particles 3"]
    deformation: Float[Tensor, "frames particles 3 3"] | None
    internal: Mapping[str, Float[Tensor, "frames particles"]]
    impulses: Float[Tensor, "frames colliders 3"]

    def __init__(
        self,
        record: SceneRecord,
        device: torch.device | str = "cpu",
        varying: Mapping[str, np.ndarray] | None = None,
        laws: Laws | None = None,
    ) -> None:
        """The motion of a record.

        varying  parameters that differ between the particles, which the record does not hold, each (particles,)
        laws     of the simulation, for the stress in files
        """
        if record.velocity is None:
            raise ValueError("a motion needs the velocities of its record")

        def tensor(values: np.ndarray) -> Tensor:
            return torch.from_numpy(values).to(device)

        self.record, self._varying, self._laws = record, dict(varying or {}), laws
        self.time, self.position, self.velocity = (
            tensor(values) for values in (record.time, record.position, record.velocity)
        )
        impulses = np.zeros((len(record.time), 0, 3)) if record.impulses is None else record.impulses
        self.impulses = tensor(impulses)
        states = record.states_at_frames
        self.deformation = None if states is None else tensor(states.deformation)
        self.internal = {} if states is None else {name: tensor(values) for name, values in states.internal.items()}

    def __len__(self) -> int:
        """Number of frames."""
        return len(self.time)

    def __repr__(self) -> str:
        frames, count, _ = self.position.shape
        return f"Motion({self.record.name!r}, {frames} frames, {count} particles, {float(self.time[-1]):.4g} s)"

    def _repr_png_(self) -> bytes:
        """The picture of five frames that a notebook shows."""
        with tempfile.TemporaryDirectory() as folder:
            return self.save(Path(folder) / "motion.png").read_bytes()

    def save(self, path: str | Path, frame: int | None = -1) -> Path:
        """Writes the motion to a file, whole or not at all, and returns its path. The ending decides:

        .h5 .hdf5         the trajectory file of the commands, in the precision of the motion
        .npz              arrays of NumPy
        .csv              a table, a line for each particle of each frame
        .pvd              all frames for ParaView: a collection, and a .vtu file for each frame beside it
        .vtu .ply         one frame, the last unless `frame` names another; `frame=None`: one file for each
        .usd .usda .usdc  points with a time sample for each frame, for Houdini and Blender; needs pcnclaws[usd]
        .png .pdf .svg    a picture of five frames

        All but trajectory files and pictures hold what follows from the motion, too: strains and, with
        `deformation=True`, the stress of the law. What is missing is named in one line.

        raises  UserError for another ending, and for a path that cannot be written
        """
        path = Path(path)
        ending = path.suffix.lower()
        if ending in PICTURES:
            return trajectory_picture(self.record, path)
        if ending not in FORMATS:
            raise UserError(f"{path} does not end in a known format; accepted: {', '.join((*FORMATS, *PICTURES))}")
        if self._varying and not FORMATS[ending].is_derived:
            log.warning("%s: not part of the file: %s of each particle", path, ", ".join(self._varying))
        write_motion(path, ParticleFields(self.record, self._laws, self._varying), frame)
        return path
