"""A scene for programs: a body, its constitutive model, its start, and the settings; simulated and differentiated."""

import logging
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor
from torch.autograd import forward_ad

from pcnclaws.data.restart_files import Restart, read_restart, restart
from pcnclaws.data.units import check_spacing
from pcnclaws.errors import SimulationDiverged, UserError, unknown_name
from pcnclaws.geometry.body import Body
from pcnclaws.interface.given import Vector, all_of, check_frames, shown, vector
from pcnclaws.interface.motion import Motion
from pcnclaws.interface.precision import Precision, precision_of
from pcnclaws.interface.settings import Settings
from pcnclaws.interface.start import checked_start
from pcnclaws.laws.constitutive_model import ConstitutiveModel
from pcnclaws.laws.given_values import Value, checked_values, of_particles
from pcnclaws.laws.training_ranges import outside_training_data
from pcnclaws.mpm.colliders import Collider
from pcnclaws.mpm.loads import Load
from pcnclaws.simulation.batch import SceneBatch, batch_scenes
from pcnclaws.simulation.execution import Execution
from pcnclaws.simulation.particle_spacing import warn_of_sparse_particles
from pcnclaws.simulation.recorded_runs import simulate_records
from pcnclaws.simulation.recording import FramePlan
from pcnclaws.simulation.restart import with_exact_masses
from pcnclaws.simulation.rollout import positions_at
from pcnclaws.simulation.simulator import simulator_of
from pcnclaws.simulation.time_step import stability_of
from pcnclaws.tensors.layout import particles_first, particles_last

log = logging.getLogger(__name__)

NOTHING = (0.0, 0.0, 0.0)
OPTIONS = ("body", "law", "velocity", "spin", "settings", "colliders", "loads", "start_time", "name")
# What a restart state says itself.
OF_STARTS = ("body", "velocity", "spin", "start_time")


class Scene:
    """A body of one material, its physical parameters, its start and its settings. Never changed: see `with_`.

    body        see Body
    law         see load_law and analytic_law
    velocity    initial velocity [m/s], (3,) or one a particle (particles, 3)
    spin        rigid rotation about the centre of the body that is added [rad/s], (3,)
    settings    see Settings; None: the paper's
    colliders   obstacles, which act in this order, after the walls; see Collider
    loads       forces and accelerations on parts of the body; see Load
    start_time  from which colliders move and loads act [s]: of a scene that goes on from a later frame
    name        of the scene in messages and files, the body's unless given
    parameters  physical parameters by name: a number, a tensor of one value, or one value a particle; those that are
                missing are in the middle of the law's ranges
    raises      UserError for unknown names with the nearest known one, for values that are not accepted, and for a body
                outside of the domain or in a collider

    Velocity, spin, parameters and the numbers of colliders and loads may be tensors that require gradients.
    """

    def __init__(
        self,
        body: Body,
        law: ConstitutiveModel,
        *,
        velocity: Vector = NOTHING,
        spin: Vector = NOTHING,
        settings: Settings | None = None,
        colliders: Sequence[Collider] = (),
        loads: Sequence[Load] = (),
        start_time: float | int = 0.0,
        name: str | None = None,
        **parameters: Value,
    ) -> None:
        settings = Settings() if settings is None else settings
        for one, given, kind in (
            ("body", body, Body),
            ("law", law, ConstitutiveModel),
            ("settings", settings, Settings),
        ):
            if not isinstance(given, kind):
                raise UserError(f"scene.{one}={given!r} is not accepted; accepted: a {kind.__name__}")
        self.body, self.law, self.settings = body, law, settings
        self.name = body.name if name is None else name
        self.colliders, self.loads = all_of("colliders", colliders, Collider), all_of("loads", loads, Load)
        self._given = {"velocity": velocity, "spin": spin, "settings": self.settings, "name": name, **parameters}
        self._given |= {"colliders": self.colliders, "loads": self.loads, "start_time": start_time}
        middle = {one: 0.5 * (low + high) for one, (low, high) in law.ranges.items()}
        self._values = middle | checked_values(parameters, law.physical_parameters, (len(body),), OPTIONS)
        self._velocity, self._affine = body.start_motion(
            vector("velocity", velocity, ((3,), (len(body), 3))), vector("spin", spin, ((3,),))
        )
        self._restart: Restart | None = None
        self._start = checked_start(
            body,
            law.material,
            replace(settings.of(law.material, body), colliders=self.colliders, loads=self.loads, start_time=start_time),
            self._values,
            name=self.name,
            velocity=self._velocity,
            affine=self._affine,
            is_automatic=settings.is_automatic,
        )
        self._said: set[object] = set()

    @property
    def parameters(self) -> dict[str, float | Tensor]:
        """All physical parameters by name."""
        return dict(self._values)

    @property
    def time_step(self) -> float:
        """[s]."""
        return self._start.settings.time_step

    @property
    def cfl(self) -> float:
        """CFL number dt (c + |v|) / dx [-]: c of the stiffest particle, |v| after the fall to the wall."""
        return stability_of(self._start, self.law.material).cfl

    @property
    def stable_time_step(self) -> float:
        """The largest stable time step [s], from the measured stability boundary; longer ones are refused."""
        return stability_of(self._start, self.law.material).longest_time_step

    def with_(self, **changes: Any) -> "Scene":
        """The scene with other arguments: body, law, velocity, ..., or parameters."""
        arguments = {"body": self.body, "law": self.law} | self._given | changes
        scene = Scene(**arguments)
        scene._said = self._said  # a loop hears once of what is doubtful
        if self._restart is not None:
            for name in OF_STARTS:
                if name in changes:
                    raise UserError(f"scene.{name} has no effect on a scene that goes on from a restart state")
            scene._go_on(self._restart)
        return scene

    def restarted(self, source: Motion | str | Path, frame: int = -1, name: str | None = None) -> "Scene":
        """The scene from a recorded frame of its motion on: k steps and N - k steps are N steps, to the last bit.

        Position, velocity, C, F and internal variables are those of the frame; law, parameters, settings, colliders and
        loads stay those of the scene, at the time of the frame. What differs from the recording is named in one line.

        source  a trajectory file, or a motion, with restart states: `deformation=True`, `keyframe_every=` of simulate
        frame   counted from the end where it is negative
        name    of the scene, where the file holds several
        raises  UserError for a frame without restart state, and for another number of particles
        """
        if isinstance(source, Motion):
            found = restart(source.record, frame, "frame")
        else:
            found = read_restart(source, name, frame, "frame")
        if len(found.state.position) != len(self.body):
            raise UserError(
                f"frame={frame} of {found.record.label} has {len(found.state.position)} particles; accepted: those of "
                f"the scene, {len(self.body)}"
            )
        scene = self.with_() if self._restart is None else Scene(self.body, self.law, **self._given)
        scene._said = self._said
        scene._go_on(found)
        return scene

    def simulate(
        self,
        steps: int = 500,
        every: int = 5,
        dtype: torch.dtype | None = None,
        device: str | torch.device | None = None,
        *,
        deformation: bool = False,
    ) -> Motion:
        """The motion of the scene, without gradients.

        every         steps between frames
        dtype         of the simulation and of the motion; None: that of the tensors that the scene was given, else
                      torch.float32
        device        None: that of these tensors, else the CPU
        deformation   keep F and internal variables at the frames, and with them restart states in trajectory files
        raises        UserError for a time step above the stability boundary, SimulationDiverged, naming scene, step and
                      particle
        """
        return simulate_scenes([self], steps, every, dtype, device, deformation=deformation)[0]

    def rollout(
        self,
        steps: int = 500,
        every: int = 5,
        *,
        dtype: torch.dtype | None = None,
        device: str | torch.device | None = None,
        **tensors: Any,
    ) -> Float[Tensor, "frames particles 3"]:
        """Positions at the frames [m], the start among them, differentiable.

        Gradients reach whatever tensor requires them: `tensors`, what the scene was given, the weights of its law.

        tensors  parameters, `velocity`, `spin`, `colliders`, `loads` instead of those of the scene, as in `with_`
        dtype    None: that of the tensors, those that are given here before those of the scene, else torch.float32
        raises   as simulate
        """
        scene = self.with_(**tensors) if tensors else self
        precision = precision_of(dtype, device, tensors.values(), scene._tensors())
        return scene._positions(steps, every, precision)

    def sensitivity(
        self,
        name: str,
        steps: int = 500,
        every: int = 5,
        *,
        dtype: torch.dtype | None = None,
        device: str | torch.device | None = None,
    ) -> Float[Tensor, "frames particles 3"]:
        """Derivative of the positions at the frames with respect to a parameter, in forward mode (a JVP).

        name    of a physical parameter; where it differs between the particles, of all its values at once
        unit    m per unit of the parameter
        raises  UserError for an unknown name, otherwise as simulate
        """
        if name not in self.law.parameter_names:
            raise unknown_name("sensitivity", name, self.law.parameter_names)
        precision = precision_of(dtype, device, [], self._tensors())
        value = torch.as_tensor(self._values[name], dtype=precision.dtype, device=precision.device).detach()
        with torch.no_grad(), forward_ad.dual_level():
            dual = forward_ad.make_dual(value, torch.ones_like(value))
            found, derivative = forward_ad.unpack_dual(self.with_(**{name: dual})._positions(steps, every, precision))
            return torch.zeros_like(found) if derivative is None else derivative

    def __repr__(self) -> str:
        values = ", ".join(f"{name}={shown(value)}" for name, value in self._values.items())
        return f"Scene({self.name!r}, {len(self.body)} particles, {self.law.material.name}: {values})"

    def _positions(self, steps: int, every: int, precision: Precision) -> Float[Tensor, "frames particles 3"]:
        check_frames(steps, every)
        self._check_run()
        simulator = simulator_of(self.law.laws_in(precision.dtype, precision.device), self._start.settings)
        batch = self._differentiable_batch(precision)
        position = particles_first(positions_at(simulator, batch, range(0, steps + 1, every), steps=steps), frames=True)
        self._require_physical(position.detach(), steps, every, precision)
        return position

    def _differentiable_batch(self, precision: Precision) -> SceneBatch:
        """The scene as a batch of one, through which derivatives reach what was given."""
        remembered = self.law.laws.internal_variables
        batch = batch_scenes([self._start], precision.dtype, precision.device, remembered)
        velocity, affine = (one.to(precision.device, precision.dtype) for one in (self._velocity, self._affine))
        state = batch.state._replace(velocity=particles_last(velocity), affine=particles_last(affine))
        parameters = of_particles(self._values, (len(self.body),), batch.state.position)
        return batch._replace(state=state, parameters=parameters)

    def _require_physical(self, position: Tensor, steps: int, every: int, precision: Precision) -> None:
        """Raises the error that names step and particle where positions are not finite or outside of the domain."""
        low, high = (position.new_tensor(corner) for corner in self._start.settings.limits)
        if bool(((position >= low) & (position <= high)).all()):
            return
        with torch.no_grad():
            self.simulate(steps, every, precision.dtype, precision.device)
        raise SimulationDiverged(f"scene '{self.name}' diverged: its positions are not finite or outside of the domain")

    def _tensors(self) -> list[Any]:
        """What decides on the precision: what the scene was given, and weights that somebody trains."""
        return [*self._given.values(), *(weight for weight in self.law.parameters() if weight.requires_grad)]

    def _go_on(self, found: Restart) -> None:
        """Makes this scene start from a restart state."""
        self._restart, own = found, self._start
        settings = replace(own.settings, time_step=found.time_step) if self.settings.is_automatic else own.settings
        later = found.going_on(own.material, own.parameters, settings)
        self._start = replace(later, name=self.name, varying=own.varying, volume=own.volume, density=own.density)
        self._velocity = torch.from_numpy(later.velocity.astype(np.float64))
        affine = np.zeros((len(self.body), 3, 3)) if later.affine is None else later.affine.astype(np.float64)
        self._affine = torch.from_numpy(affine)

    def _check_run(self) -> None:
        """Refuses an unstable time step; says what is doubtful, once of a scene and of all that `with_` makes of it."""
        start, stability = self._start, stability_of(self._start, self.law.material)
        if not stability.is_stable or self._is_new("time step", start.settings.time_step):
            stability.check()
        if self._is_new("particles", self.body, start.settings.grid_spacing):
            warn_of_sparse_particles([start])
            check_spacing(f"body '{self.body.name}'", start.position, start.volume)
        each = start.of_particles()
        extremes = [{name: float(end(values)) for name, values in each.items()} for end in (np.min, np.max)]
        line = outside_training_data(self.law.ranges, extremes) if self.law.is_trained else None
        if line and self._is_new("parameters", self.law, line):
            log.warning("law=%s: %s", self.law.source, line)

    def _is_new(self, *said: object) -> bool:
        new = said not in self._said
        self._said.add(said)
        return new


def simulate_scenes(
    scenes: Sequence[Scene],
    steps: int = 500,
    every: int = 5,
    dtype: torch.dtype | None = None,
    device: str | torch.device | None = None,
    *,
    deformation: bool = False,
) -> list[Motion]:
    """The motions of several scenes, those of the same law and settings as one batch; in the order of `scenes`.

    Arguments and errors as of Scene.simulate.
    """
    check_frames(steps, every)
    if not scenes:
        raise UserError("no scene is given; accepted: one or more")
    for scene in scenes:
        scene._check_run()
    precision = precision_of(dtype, device, [], [given for scene in scenes for given in scene._tensors()])
    starts = [replace(scene._start, name=name) for scene, name in zip(scenes, _names(scenes), strict=True)]
    motions: dict[int, Motion] = {}
    for law in dict.fromkeys(scene.law for scene in scenes):
        of_law = [k for k, scene in enumerate(scenes) if scene.law is law]
        group = [starts[k] for k in of_law]
        plan = FramePlan(steps, every, every if deformation else 0, velocities=True)
        try:
            records = simulate_records(group, law.laws, plan, Execution(precision.dtype, precision.device))
        except SimulationDiverged as error:
            named = next((start for start in group if f"scene '{start.name}'" in str(error)), group[0])
            raise type(error)(f"{error}; {stability_of(named, law.material).advice(error)}") from error
        for k, record in zip(of_law, records, strict=True):
            exact = with_exact_masses(record, starts[k])
            motions[k] = Motion(exact, precision.device, starts[k].varying, law.laws)
    return [motions[k] for k in range(len(scenes))]


def _names(scenes: Sequence[Scene]) -> list[str]:
    """The names of the scenes, numbered where two are the same."""
    names = [scene.name for scene in scenes]
    return [f"{name}_{k}" if names.count(name) > 1 else name for k, name in enumerate(names)]
