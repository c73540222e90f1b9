"""Fields of the particles of a recorded motion: what the record holds, and what follows from it. Particle-first."""

import copy
from collections.abc import Callable, Mapping, Sequence
from functools import cached_property
from typing import NamedTuple

import numpy as np
import torch
from torch import Tensor

from pcnclaws.laws.analytic import Laws
from pcnclaws.laws.base import Elasticity
from pcnclaws.laws.parameters import PARAMETERS
from pcnclaws.simulation.connected_bodies import connected_bodies
from pcnclaws.simulation.records import Keyframes, SceneRecord
from pcnclaws.tensors.layout import matrices_first, matrices_last
from pcnclaws.tensors.linalg3 import determinant, deviator, hencky_strain, trace

# What the names of internal variables begin with, beside those of other fields.
INTERNAL = "internal_"
VELOCITY, DEFORMATION, STRESS = "velocity", "F", "stress"


class Field(NamedTuple):
    """A field that follows from the state of the particles.

    label   for axes, with the unit
    needs   what the record must hold for it: VELOCITY, DEFORMATION, or STRESS for F and a law
    values  of a frame, (particles, ...)
    """

    label: str
    needs: str
    values: Callable[["_State"], np.ndarray]


FIELDS: Mapping[str, Field] = {
    "velocity": Field("velocity [m/s]", VELOCITY, lambda state: state.velocity),
    "speed": Field("speed [m/s]", VELOCITY, lambda state: np.linalg.norm(state.velocity, axis=1)),
    "deformation": Field("elastic deformation gradient F [-]", DEFORMATION, lambda state: state.deformation),
    "hencky_norm": Field("elastic Hencky strain |h| [-]", DEFORMATION, lambda state: _norm(state.hencky)),
    "volume_ratio": Field("det F [-]", DEFORMATION, lambda state: state.volume_ratio.numpy()),
    "equivalent_strain": Field(
        "equivalent elastic strain [-]", DEFORMATION, lambda state: (2.0 / 3.0) ** 0.5 * _norm(deviator(state.hencky))
    ),
    "kirchhoff_stress": Field("Kirchhoff stress [Pa]", STRESS, lambda state: matrices_last(state.kirchhoff)),
    "cauchy_stress": Field("Cauchy stress [Pa]", STRESS, lambda state: matrices_last(state.cauchy)),
    "pressure": Field("pressure [Pa]", STRESS, lambda state: (trace(state.cauchy) / -3.0).numpy()),
    "von_mises_stress": Field("von Mises stress [Pa]", STRESS, lambda state: 1.5**0.5 * _norm(deviator(state.cauchy))),
}


class ParticleFields:
    """The fields of a recorded motion, frame by frame, in the precision of the record.

    id, body                  number of the particle; of the connected body that it starts in
    volume, density           at the start [m^3], [kg/m^3]
    those of FIELDS           strains are elastic: those of the recorded F, which plastic flow has changed
    initial_affine            C at the start [1/s], where it is not 0
    the physical parameters   by name, one value a particle
    internal_<name>           internal variables of the law

    record   the motion; F and internal variables are those of its restart states, if every frame has one
    laws     whose stress it is, None for none; why says why there is none
    varying  parameters that differ between the particles, by name, (particles,)
    """

    def __init__(
        self,
        record: SceneRecord,
        laws: Laws | None = None,
        varying: Mapping[str, np.ndarray] | None = None,
        why: str = "no law is given",
    ) -> None:
        self.record, self._why = record, why
        self._elasticity = None if laws is None else copy.deepcopy(laws.elasticity).double()
        self._parameters = {
            name: np.broadcast_to(np.asarray(value), record.volume.shape)
            for name, value in (dict(record.parameters) | dict(varying or {})).items()
        }
        self._needed = [] if laws is None else [*laws.elasticity.parameter_names]

    @cached_property
    def missing(self) -> Mapping[str, str]:
        """Fields that there are not, each with what it lacks."""
        reasons = {VELOCITY: self._velocity_fault, DEFORMATION: self._deformation_fault, STRESS: self._stress_fault}
        return {name: why for name, one in FIELDS.items() if (why := reasons[one.needs])}

    @cached_property
    def fixed(self) -> Mapping[str, np.ndarray]:
        """The fields that are the same in all frames, each (particles, ...)."""
        record, kind = self.record, self.record.position.dtype
        density = record.settings.density if record.density is None else record.density
        whole = {
            "id": np.arange(len(record.volume), dtype=np.int32),
            "body": connected_bodies(record.position[0], record.volume),
            "volume": record.volume.astype(kind),
            "density": np.broadcast_to(np.asarray(density), record.volume.shape).astype(kind),
        }
        if record.initial_affine is not None:
            whole["initial_affine"] = record.initial_affine.astype(kind)
        return whole | {name: values.astype(kind) for name, values in self._parameters.items()}

    @property
    def moving(self) -> tuple[str, ...]:
        """Names of the fields that differ between the frames."""
        states = self.record.states_at_frames
        internal = [] if states is None else [f"{INTERNAL}{name}" for name in states.internal]
        return (*(name for name in FIELDS if name not in self.missing), *internal)

    def label(self, name: str) -> str:
        """Name and unit of a field, as axes have them."""
        if name in FIELDS:
            return FIELDS[name].label
        if name in PARAMETERS:
            return f"{PARAMETERS[name].symbol} [{PARAMETERS[name].unit}]"
        return {"volume": "volume [m³]", "density": "density [kg/m³]"}.get(name, name.removeprefix(INTERNAL))

    def at(self, frame: int, names: Sequence[str] | None = None) -> dict[str, np.ndarray]:
        """The fields of a frame by name, each (particles, ...); all, or those of these names."""
        state = _State(self, frame)
        names = (*self.fixed, *self.moving) if names is None else names
        return {name: self._of(name, state) for name in names}

    def seen(self, frame: int) -> np.ndarray:
        """Whether each particle was observed in a frame, (particles,)."""
        return np.isfinite(self.record.position[frame]).all(1)

    def _of(self, name: str, state: "_State") -> np.ndarray:
        if name in self.fixed:
            return self.fixed[name]
        if name.startswith(INTERNAL) and name not in FIELDS:
            return state.states.internal[name.removeprefix(INTERNAL)][state.frame]
        return FIELDS[name].values(state).astype(self.record.position.dtype)

    @property
    def _velocity_fault(self) -> str:
        return "" if self.record.velocity is not None else "it was not recorded"

    @property
    def _deformation_fault(self) -> str:
        record = self.record
        if record.states_at_frames is not None:
            return ""
        kept = 0 if record.keyframes is None else len(record.keyframes.step)
        steps = np.unique(np.diff(record.time))
        every = round(float(steps[0]) / record.settings.time_step) if len(steps) else 1
        return (
            f"F is in {kept} of {len(record.time)} frames (simulate keyframe_every={every}, in Python "
            "Scene.simulate(deformation=True))"
        )

    @property
    def _stress_fault(self) -> str:
        if fault := self._deformation_fault:
            return fault
        if self._elasticity is None:
            return self._why
        unknown = [name for name in self._needed if name not in self._parameters]
        return f"the file does not say {', '.join(unknown)}" if unknown else ""


class _State:
    """A frame of a record, and what is derived from it, component-first in double precision; each at most once."""

    def __init__(self, fields: ParticleFields, frame: int) -> None:
        self._fields, self.frame = fields, frame

    @property
    def velocity(self) -> np.ndarray:
        velocity = self._fields.record.velocity
        if velocity is None:
            raise ValueError("the record has no velocities")
        return velocity[self.frame]

    @property
    def states(self) -> Keyframes:
        states = self._fields.record.states_at_frames
        if states is None:
            raise ValueError("the record has no deformation gradients at its frames")
        return states

    @property
    def deformation(self) -> np.ndarray:
        return self.states.deformation[self.frame]

    @cached_property
    def _first(self) -> Tensor:
        return torch.from_numpy(matrices_first(self.deformation.astype(np.float64)))

    @cached_property
    def hencky(self) -> Tensor:
        return hencky_strain(self._first)

    @cached_property
    def volume_ratio(self) -> Tensor:
        return determinant(self._first)

    @cached_property
    @torch.no_grad()
    def kirchhoff(self) -> Tensor:
        elasticity: Elasticity | None = self._fields._elasticity
        if elasticity is None:
            raise ValueError("there is no law")
        known = {**self._fields._parameters} | {
            name: values[self.frame] for name, values in self.states.internal.items()
        }
        return elasticity.kirchhoff_stress(
            self._first, {name: torch.from_numpy(values.astype(np.float64)) for name, values in known.items()}
        )

    @property
    def cauchy(self) -> Tensor:
        return self.kirchhoff / self.volume_ratio


def _norm(matrices: Tensor) -> np.ndarray:
    return matrices.square().sum((0, 1)).sqrt().numpy()
