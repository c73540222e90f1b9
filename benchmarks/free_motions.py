"""The closed forms as scenes to simulate, and how far a simulation is from them."""

import math
from collections.abc import Callable

import numpy as np

from benchmarks.cell_lattices import Lattice
from benchmarks.closed_forms import PARAMETERS, ClosedForm, FreeBar, SteadyRotation, TravellingWave
from benchmarks.timed_runs import Resolution, Scenario, TimedRun
from pcnclaws.mpm.diagnostics import angular_momentum
from pcnclaws.simulation.scenes import SceneStart

NO_GRAVITY = (0.0, 0.0, 0.0)
# Thickness of the wall layer [m] of a domain whose walls are never met.
NO_WALLS = 0.0


class FreeMotion(Scenario):
    """A closed form as a scenario: starts on the exact motion."""

    def __init__(self, name: str, exact: ClosedForm) -> None:
        self.name, self.exact = name, exact
        self.box, self.duration, self.frames = exact.box, exact.duration, exact.frames

    def start(self, lattice: Lattice, resolution: Resolution) -> SceneStart:
        """The start; velocities are those of half a step earlier, where symplectic Euler has them."""
        settings = self.settings(resolution, NO_GRAVITY, NO_WALLS)
        now = self.exact.motion(lattice.position, 0.0)
        before = self.exact.motion(lattice.position, -0.5 * settings.time_step)
        return SceneStart(
            self.name,
            "elasticity",
            settings,
            PARAMETERS,
            now.position,
            before.velocity,
            lattice.volume,
            before.affine,
            now.deformation,
        )

    def errors(self, run: TimedRun) -> dict[str, float]:
        """{"error": ..., and what is particular to the motion}.

        error  root mean square of the position error over particles and frames, relative to that of the
               displacement from the undeformed body
        """
        exact = self._exact_frames(run)
        moved = exact - run.lattice.position.T
        error = math.sqrt(np.square(run.position - exact).sum() / np.square(moved).sum())
        return {"error": error, **_PARTICULAR[type(self.exact)](self.exact, run)}

    def _exact_frames(self, run: TimedRun) -> np.ndarray:
        times = [self.duration * (k + 1) / self.frames for k in range(self.frames)]
        return np.stack([self.exact.motion(run.lattice.position, time).position.T for time in times])


def _bar(exact: FreeBar, run: TimedRun) -> dict[str, float]:
    """Relative error of the frequency, from the phase after one period, and the share of the amplitude that is left."""
    points = run.lattice.position
    shape = np.sin(exact.wave_number * (points[:, 0] - exact.box.middle[0]))
    velocity = run.final.velocity.double().cpu().numpy()[0]
    u = (run.position[-1, 0] - points[:, 0]) @ shape * exact.angular_frequency
    v = velocity @ shape
    largest = exact.largest_strain * exact.wave_speed * (shape @ shape)
    return {
        "frequency_error": math.atan2(u, v) / (2.0 * math.pi),
        "amplitude_left": math.hypot(u, v) / largest,
    }


def _wave(exact: TravellingWave, run: TimedRun) -> dict[str, float]:
    """Relative error of the wave speed, from the middle of the displacement, and the share of its size that is left."""
    along = run.lattice.position[:, 0]
    u = run.position[-1, 0] - along
    started = exact.axial(along, 0.0)[0]
    travelled = float((u @ along) / u.sum()) - exact.start
    return {
        "speed_error": travelled / (exact.wave_speed * exact.duration) - 1.0,
        "amplitude_left": math.sqrt(float(u @ u) / float(started @ started)),
    }


def _rotation(exact: SteadyRotation, run: TimedRun) -> dict[str, float]:
    """Relative errors of the angle and the angular momentum, and the change of shape relative to the body's size."""
    arm = exact.stretched(run.lattice.position)[0].T
    turned = run.position[-1] - exact.box.middle[:, None]
    angle = math.atan2(float((arm[0] * turned[1] - arm[1] * turned[0]).sum()), float((arm[:2] * turned[:2]).sum()))
    cosine, sine = math.cos(angle), math.sin(angle)
    back = np.stack((cosine * turned[0] + sine * turned[1], cosine * turned[1] - sine * turned[0], turned[2]))
    spins = [
        float(angular_momentum(state, run.batch.scenes, run.settings.grid_spacing)[2, 0])
        for state in (run.batch.state, run.final)
    ]
    return {
        "angle_error": angle / (exact.spin * exact.duration) - 1.0,
        "shape_error": math.sqrt(np.square(back - arm).sum() / np.square(arm).sum()),
        "angular_momentum_error": spins[1] / spins[0] - 1.0,
    }


_PARTICULAR: dict[type, Callable[..., dict[str, float]]] = {
    FreeBar: _bar,
    TravellingWave: _wave,
    SteadyRotation: _rotation,
}
