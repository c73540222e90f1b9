"""Least-squares problem of an estimation: residuals of a simulated motion and their Jacobian.

Candidates, and the copies of the scene that carry one derivative each, are scenes of one batch. Derivatives are exact,
in forward mode: a rollout of K copies gives the Jacobian of K unknowns, and no graph is kept. Those of what stands
around the body are central differences, and on a GPU, whose kernels have no forward mode, all of them are. Motions are
simulated on the device; what is compared with the observation is on the CPU.
"""

from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor
from torch.autograd import forward_ad

from pcnclaws.data.observation import Observation
from pcnclaws.estimation.comparison import Assignment, comparison_of, rates_of_offset
from pcnclaws.estimation.scene_copies import Carried, SceneCopies
from pcnclaws.estimation.surroundings import DIFFERENCE, displacement, friction_of, gravity_of, is_felt
from pcnclaws.estimation.unknowns import SURFACE_OFFSET, TIME_OFFSET, Unknowns
from pcnclaws.laws.analytic import Laws
from pcnclaws.mpm.settings import SimulationSettings
from pcnclaws.simulation.batch import SceneBatch
from pcnclaws.simulation.execution import SINGLE_ON_CPU, Execution
from pcnclaws.simulation.rollout import positions_at
from pcnclaws.simulation.scenes import SceneStart
from pcnclaws.simulation.simulator import Simulator, simulator_of
from pcnclaws.simulation.time_step import stability_of
from pcnclaws.tensors.layout import matrices_last, vectors_last

# So many particles are simulated at once, on a CPU and on a GPU.
PARTICLES_AT_ONCE = {"cpu": 16_384, "cuda": 1_048_576}
# A frame so near to a step, in steps, is at the step.
AT_STEP = 1e-3


class Linearisation(NamedTuple):
    """The motion around some coordinates.

    residual  simulated less observed positions [m], (rows,): coordinates of markers, or distances of points
    jacobian  its change with the coordinates [m], (unknowns, rows)
    part      the marker, or the patch of the surface, of each row, (rows,)
    """

    residual: Float[np.ndarray, " rows"]
    jacobian: Float[np.ndarray, "unknowns rows"]
    part: np.ndarray

    @property
    def mse(self) -> float:
        """Mean squared residual [m^2]; infinite where the simulation left the physical world."""
        mean = float(np.mean(np.square(self.residual)))
        return mean if np.isfinite(mean) and np.isfinite(self.jacobian).all() else np.inf


class _Interpolation(NamedTuple):
    """Frames between steps: positions are (1 - share) x[before] + share x[after], of the positions at `steps`."""

    steps: list[int]
    before: np.ndarray
    after: np.ndarray
    share: np.ndarray


class EstimationProblem:
    """An observation, the laws that are to explain it, and the unknowns that they may choose.

    laws       frozen, of the observation's material
    execution  without progress
    """

    def __init__(
        self,
        laws: Laws,
        observation: Observation,
        unknowns: Unknowns,
        execution: Execution = SINGLE_ON_CPU,
    ) -> None:
        self.laws, self.observation, self.unknowns = laws, observation, unknowns
        self.execution, self.dtype = execution, execution.dtype
        self.device = torch.device(execution.device)
        self.simulator = self._simulator(observation.settings)
        self._scene = SceneCopies(observation, unknowns, self.dtype)
        self._particle = torch.from_numpy(np.ascontiguousarray(observation.particle))
        self._weight = self._scene.tensor(observation.weight)
        self.comparison = comparison_of(observation, self.dtype)

    def mse(self, candidates: Sequence[np.ndarray]) -> list[float]:
        """Mean squared distance [m^2] of each candidate's motion; infinite where it is unstable or diverges."""
        found = []
        for u in candidates:
            found.append(np.inf if self.instability(u) > 1.0 else None)
        running = [k for k, value in enumerate(found) if value is None]
        for first in range(0, len(running), self._copies):
            chunk = running[first : first + self._copies]
            values = [self.unknowns.values(candidates[k]) for k in chunk]
            with torch.no_grad():
                motion = self._observed(values, [None] * len(chunk))
            for k, one in zip(chunk, motion.unbind(2), strict=True):
                residual = self._assigned(one, self.unknowns.values(candidates[k])).residual(one)
                mean = float(residual.double().square().mean())
                found[k] = mean if np.isfinite(mean) else np.inf
        return [float(value) for value in found if value is not None]

    def linearise(self, u: Float[np.ndarray, " unknowns"]) -> Linearisation:
        """The residual and its exact Jacobian at some coordinates."""
        values, slopes = self.unknowns.values(u), self.unknowns.slopes(u)
        rows = self.comparison.rows
        jacobian = np.zeros((len(u), rows))
        if self.instability(u) > 1.0:
            return Linearisation(np.full(rows, np.inf), jacobian, np.zeros(rows, dtype=np.int64))
        found, rates = self._rates(values, slopes)
        for k in self.unknowns.index(TIME_OFFSET):
            rates[k] = slopes[k] * self._velocity(values)
        for k in self.unknowns.index(SURFACE_OFFSET):
            rates[k] = slopes[k] * rates_of_offset(found)
        rates |= self.differences(u, self._by_differences)
        assignment = self._assigned(found, values)
        for k, rate in rates.items():
            jacobian[k] = assignment.change(rate).double().numpy()
        return Linearisation(assignment.residual(found).double().numpy(), jacobian, assignment.part)

    def loss(self, coordinates: Float[Tensor, " unknowns"]) -> Float[Tensor, ""]:
        """Mean squared distance [m^2] as a differentiable function of the coordinates, in reverse mode."""
        u = coordinates.detach().double().numpy()
        values, slopes = self.unknowns.values(u), self.unknowns.slopes(u)
        # the value is exact, the derivative that of the transform
        free = torch.as_tensor(values) + torch.as_tensor(slopes) * (coordinates.double() - torch.as_tensor(u))
        plan = self._interpolation(values)
        friction = friction_of(self.unknowns, values, self.observation.settings)
        found = self._positions(self._scene.differentiable(values, free), plan, friction)
        motion = self._displaced(self._at_frames(found[:, :, None, :], plan, [values]), [values])[:, :, 0]
        for k in self.unknowns.index(SURFACE_OFFSET):
            motion = motion + (free[k] - values[k]).to(self.dtype) * rates_of_offset(motion)
        return self._assigned(motion, values).residual(motion).square().mean()

    def motion(self, u: Float[np.ndarray, " unknowns"]) -> Float[np.ndarray, "frames markers 3"]:
        """Simulated positions of the markers at the frames [m]."""
        with torch.no_grad():
            found = self._observed([self.unknowns.values(u)], [None])
        return vectors_last(found[:, :, 0])

    def residual(self, u: Float[np.ndarray, " unknowns"]) -> Float[np.ndarray, " rows"]:
        """The residual of linearise alone [m]; infinite where the simulation is unstable."""
        if self.instability(u) > 1.0:
            return np.full(self.comparison.rows, np.inf)
        values = self.unknowns.values(u)
        with torch.no_grad():
            motion = self._observed([values], [None])[:, :, 0]
        return self._assigned(motion, values).residual(motion).double().numpy()

    def beside(self, u: Float[np.ndarray, " unknowns"]) -> tuple[np.ndarray, np.ndarray]:
        """What was observed, and where the simulation puts it [m], each (frames, positions, 3)."""
        values = self.unknowns.values(u)
        with torch.no_grad():
            found = self._observed([values], [None])
        return self.comparison.beside(found[:, :, 0], self._surface_offset(values))

    def parts(self, u: Float[np.ndarray, " unknowns"]) -> np.ndarray:
        """The part of the body that each row tells of: Linearisation.part, without a Jacobian."""
        values = self.unknowns.values(u)
        with torch.no_grad():
            found = self._observed([values], [None])
        return self._assigned(found[:, :, 0], values).part

    def start(self, u: Float[np.ndarray, " unknowns"]) -> SceneStart:
        """Where the scene starts, on the grid: where walls are displaced, it is the body that is."""
        values, observation = self.unknowns.values(u), self.observation
        parameters = self.unknowns.parameters(values)
        return SceneStart(
            observation.name,
            observation.material,
            self._settings(values),
            {name: float(one[0]) for name, one in parameters.items() if np.ptp(one) == 0.0},
            position=vectors_last(self._scene.position(values).double()),
            velocity=vectors_last(self._scene.velocity(values).double()),
            volume=self._scene.volume(values).double().numpy(),
            affine=matrices_last(self._scene.affine(values).double()),
            density=observation.density,
            varying={name: one for name, one in parameters.items() if np.ptp(one) > 0.0},
        )

    def instability(self, u: Float[np.ndarray, " unknowns"]) -> float:
        """The largest CFL number of a particle over the one that is stable [-]."""
        stability = stability_of(self.start(u))
        return stability.cfl / stability.stable_cfl

    def _settings(self, values: np.ndarray) -> SimulationSettings:
        """Those of the observation, with the friction and the gravity that are sought."""
        settings = self.observation.settings
        if not self.unknowns.surroundings:
            return settings
        x, y, z = gravity_of(self.unknowns, values, settings.gravity).tolist()
        return replace(settings, gravity=(x, y, z), friction=friction_of(self.unknowns, values, settings))

    @property
    def _copies(self) -> int:
        return max(PARTICLES_AT_ONCE[self.device.type] // self._scene.particles, 1)

    @property
    def _by_differences(self) -> list[int]:
        """The unknowns whose derivatives are central differences."""
        unknowns = self.unknowns
        if self.device.type == "cpu":
            return unknowns.surroundings
        return [*unknowns.physical, *unknowns.motion, *unknowns.surroundings]

    def _rates(self, values: np.ndarray, slopes: np.ndarray) -> tuple[Tensor, dict[int, Tensor]]:
        """Positions of the markers (frames, 3, markers), and their rates for parameters and start velocities."""
        if self.device.type != "cpu":
            with torch.no_grad():
                return self._observed([values], [None])[:, :, 0], {}
        found, of_unknown = torch.empty(0), {}
        # apart: a body whose start velocity is sought has no free fall to skip
        for group in (self.unknowns.physical, self.unknowns.motion):
            for first in range(0, len(group), self._copies):
                chunk = group[first : first + self._copies]
                copies, rates = self._forward_mode(values, slopes, chunk)
                found = copies[:, :, 0]
                of_unknown |= dict(zip(chunk, rates.unbind(2), strict=True))
        return found, of_unknown

    def _forward_mode(self, values: np.ndarray, slopes: np.ndarray, chunk: Sequence[int]) -> tuple[Tensor, Tensor]:
        """Positions of the markers and their rates, (frames, 3, copies, markers); copy k carries unknown chunk[k]."""
        with torch.no_grad(), forward_ad.dual_level():
            dual = self._observed([values] * len(chunk), [(k, slopes[k]) for k in chunk])
            found, rates = forward_ad.unpack_dual(dual)
            return found, torch.zeros_like(found) if rates is None else rates

    def differences(self, u: Float[np.ndarray, " unknowns"], sought: Sequence[int]) -> dict[int, Tensor]:
        """Changes of the markers (frames, 3, markers) with some coordinates, by central differences."""
        if not sought:
            return {}
        ends = [u + sign * DIFFERENCE * np.eye(len(u))[k] for k in sought for sign in (1.0, -1.0)]
        values = [self.unknowns.values(end) for end in ends]
        with torch.no_grad():
            chunks = [values[n : n + self._copies] for n in range(0, len(values), self._copies)]
            motions = torch.cat([self._observed(chunk, [None] * len(chunk)) for chunk in chunks], dim=2).unbind(2)
        changes = [after - before for after, before in zip(motions[::2], motions[1::2], strict=True)]
        rates = {k: change / (2.0 * DIFFERENCE) for k, change in zip(sought, changes, strict=True)}
        return {k: rate if is_felt(self.unknowns.sought[k].name, rate) else 0.0 * rate for k, rate in rates.items()}

    def _observed(self, values: Sequence[np.ndarray], carried: Sequence[Carried]) -> Tensor:
        """Markers at the frames, (frames, 3, copies, markers), of the batch that _simulated describes."""
        plan = self._interpolation(values[0])
        return self._displaced(self._at_frames(self._simulated(values, carried, plan), plan, values), values)

    def _displaced(self, motion: Tensor, values: Sequence[np.ndarray]) -> Tensor:
        """Markers on the grid, (frames, 3, copies, markers), as they are where the walls are displaced."""
        away = np.stack([displacement(self.unknowns, one) for one in values], axis=1)
        if not away.any():
            return motion
        return motion + self._scene.tensor(away)[:, :, None] * self._weight.sum(1)

    def _simulated(self, values: Sequence[np.ndarray], carried: Sequence[Carried], plan: _Interpolation) -> Tensor:
        """Particles at the steps, (steps, 3, copies, particles), of one batch with a copy of the scene for each entry.

        carried  the unknown whose derivative a copy carries and its slope, None for none
        """
        frictions = {friction_of(self.unknowns, one, self.observation.settings) for one in values}
        if len(frictions) > 1:  # walls belong to a simulator, not to a scene
            single = [self._simulated([one], [carry], plan) for one, carry in zip(values, carried, strict=True)]
            return torch.cat(single, dim=2)
        found = self._positions(self._scene.batch(values, carried), plan, frictions.pop())
        return found.unflatten(2, (len(values), self._scene.particles))

    def _positions(self, batch: SceneBatch, plan: _Interpolation, friction: float) -> Tensor:
        simulator = self.simulator
        if friction != self.observation.settings.friction:
            simulator = self._simulator(replace(self.observation.settings, friction=friction))
        found = positions_at(simulator, batch.on(self.device), plan.steps, skips=self.execution.skips)
        return found.to("cpu")

    def _simulator(self, settings: SimulationSettings) -> Simulator:
        return simulator_of(self.laws, settings, self.execution.skips).to(device=self.device, dtype=self.dtype)

    def _at_frames(self, found: Tensor, plan: _Interpolation, values: Sequence[np.ndarray]) -> Tensor:
        """Positions of particles at steps, (steps, 3, copies, particles), as those of markers at frames."""
        markers = self._markers(found, values)
        share = self._scene.tensor(plan.share)[:, None, None, None]
        return markers[plan.before] * (1.0 - share) + markers[plan.after] * share

    def _markers(self, found: Tensor, values: Sequence[np.ndarray]) -> Tensor:
        """Positions of particles as those of the markers that follow them."""
        if self._particle.shape[1] == 1:
            return found[..., self._particle[:, 0]]
        return (found[..., self._particle] * self._scene.weights(values)).sum(-1)

    def _interpolation(self, values: np.ndarray) -> _Interpolation:
        offset = sum(values[k] for k in self.unknowns.index(TIME_OFFSET))
        step = np.maximum((self.observation.time + offset) / self.observation.settings.time_step, 0.0)
        whole = np.rint(step)
        step = np.where(np.abs(step - whole) < AT_STEP, whole, step)
        before, after = np.floor(step).astype(int), np.ceil(step).astype(int)
        if self.unknowns.index(TIME_OFFSET):  # its derivative needs two steps everywhere
            after = before + 1
        steps = sorted({*before.tolist(), *after.tolist()})
        rows = {n: row for row, n in enumerate(steps)}
        first, second = (np.array([rows[n] for n in some.tolist()]) for some in (before, after))
        return _Interpolation(steps, first, second, step - before)

    def _velocity(self, values: np.ndarray) -> Tensor:
        """Velocity of the markers at the frames [m/s], (frames, 3, markers)."""
        plan = self._interpolation(values)
        with torch.no_grad():
            markers = self._markers(self._simulated([values], [None], plan), [values])
        return (markers[plan.after] - markers[plan.before])[:, :, 0] / self.observation.settings.time_step

    def _assigned(self, motion: Tensor, values: np.ndarray) -> Assignment:
        """The observed assigned to a motion (frames, 3, markers)."""
        return self.comparison.assigned(motion, self._surface_offset(values))

    def _surface_offset(self, values: np.ndarray) -> float:
        return float(sum(values[k] for k in self.unknowns.index(SURFACE_OFFSET)))
