"""Scene records: what one group of a trajectory file holds. Particle-first arrays."""

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
from jaxtyping import Float, Int64

from pcnclaws.errors import UserError
from pcnclaws.mpm.settings import SimulationSettings

# Recorded times may be rounded: accepted distance of a frame from a whole number of steps, in steps.
TIME_TOLERANCE = 0.05
MAXIMUM_STEPS = 2**40


@dataclass(frozen=True)
class Keyframes:
    """Full states from which a run can be started again.

    step         counted from the first frame, (keyframes,)
    position     [m], (keyframes, particles, 3)
    velocity     [m/s], (keyframes, particles, 3)
    affine       APIC velocity gradient C [1/s], (keyframes, particles, 3, 3)
    deformation  elastic deformation gradient F [-], (keyframes, particles, 3, 3)
    internal     internal variables by name, each (keyframes, particles)
    """

    step: Int64[np.ndarray, " keyframes"]
    position: Float[np.ndarray, "keyframes particles 3"]
    velocity: Float[np.ndarray, "keyframes particles 3"]
    affine: Float[np.ndarray, "keyframes particles 3 3"]
    deformation: Float[np.ndarray, "keyframes particles 3 3"]
    internal: Mapping[str, Float[np.ndarray, "keyframes particles"]] = field(default_factory=dict)

    def at(self, rows: slice | np.ndarray) -> "Keyframes":
        """Some of them."""
        internal = {name: values[rows] for name, values in self.internal.items()}
        arrays = (self.step, self.position, self.velocity, self.affine, self.deformation)
        return Keyframes(*(values[rows] for values in arrays), internal=internal)


@dataclass(frozen=True)
class SceneRecord:
    """A recorded trajectory with the settings and the parameters that it belongs to.

    Arrays are of the precision of the simulation, or of the file: single or double.
    material          name of the material; need not be one of ours
    parameters        physical parameters by name, as far as they are known
    time              [s], (frames,), increasing; frames may be sparser than steps
    position          [m], (frames, particles, 3); NaN marks a particle that was not observed in that frame
    volume            initial volume [m^3], (particles,)
    initial_velocity  velocity at the first frame [m/s], (particles, 3), None when it is not known
    velocity          [m/s], (frames, particles, 3), None when it was not recorded
    source            the file, for error messages
    initial_affine    APIC velocity gradient C at the first frame [1/s], (particles, 3, 3), None for 0
    density           of each particle [kg/m^3], (particles,), None where it is that of the settings
    impulses          of each collider on the body since the start [N s], (frames, colliders, 3), None when not recorded
    loaded_at         positions by which loads act on particles [m], (particles, 3), None for those of the first frame
    """

    name: str
    material: str
    settings: SimulationSettings
    parameters: Mapping[str, float]
    time: Float[np.ndarray, " frames"]
    position: Float[np.ndarray, "frames particles 3"]
    volume: Float[np.ndarray, " particles"]
    initial_velocity: Float[np.ndarray, "particles 3"] | None = None
    velocity: Float[np.ndarray, "frames particles 3"] | None = None
    keyframes: Keyframes | None = None
    source: str = ""
    initial_affine: Float[np.ndarray, "particles 3 3"] | None = None
    density: Float[np.ndarray, " particles"] | None = None
    impulses: Float[np.ndarray, "frames colliders 3"] | None = None
    loaded_at: Float[np.ndarray, "particles 3"] | None = None

    @property
    def label(self) -> str:
        """The scene in an error message: its file, where it has one, and its name."""
        return f"{self.source}: scene '{self.name}'" if self.source else f"scene '{self.name}'"

    @property
    def states_at_frames(self) -> Keyframes | None:
        """The restart states, where all frames have one."""
        keyframes = self.keyframes
        return keyframes if keyframes is not None and len(keyframes.step) == len(self.time) else None

    def frame_steps(self) -> Int64[np.ndarray, " frames"]:
        """The step that each frame shows, counted from the first frame, (frames,).

        raises  UserError when a frame lies between two steps
        """
        steps = (self.time - self.time[0]) / self.settings.time_step
        whole = np.rint(steps)
        if np.any(np.diff(whole) < 1) or np.abs(steps - whole).max() > TIME_TOLERANCE or steps[-1] > MAXIMUM_STEPS:
            raise UserError(
                f"{self.label}: its times lie between the steps; accepted: increasing times that are "
                f"multiples of its time_step={self.settings.time_step:g} s after the first one"
            )
        return whole.astype(np.int64)
