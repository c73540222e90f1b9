"""Physical states: which particles have gone wrong, and in words, where and how."""

from collections.abc import Sequence

import torch

from pcnclaws.compiled.calls import kernels_serve
from pcnclaws.compiled.failing import failing
from pcnclaws.mpm.settings import UNIT_BOX, Domain
from pcnclaws.mpm.state import ParticleState
from pcnclaws.tensors.linalg3 import determinant
from pcnclaws.tensors.tensor_types import ParticleMask


def failing_particles(state: ParticleState, limits: Domain = UNIT_BOX) -> ParticleMask:
    """Particles whose state is not physical: not finite, outside the domain, or det F <= 0.

    limits  SimulationSettings.limits
    """
    if kernels_serve(state.position, (state.deformation,)):
        return failing(state.position, state.deformation, limits)
    low, high = (state.position.new_tensor(corner)[:, None] for corner in limits)
    inside = ((state.position >= low) & (state.position <= high)).all(0)
    # comparisons with NaN are false, and an infinite velocity leaves the domain in the next step
    return ~(inside & (determinant(state.deformation) > 0.0))


def left_domain(state: ParticleState, particle: int, limits: Domain = UNIT_BOX) -> bool:
    """Whether a particle is at a known place outside the domain."""
    position = state.position[:, particle]
    low, high = (position.new_tensor(corner) for corner in limits)
    return bool(torch.isfinite(position).all() and ((position < low) | (position > high)).any())


def domain_in_words(domain: Domain) -> str:
    """The box of a domain [m], as in 'outside the domain ...'."""
    if domain == UNIT_BOX:
        return "the domain [0, 1]^3 m"
    edges = (f"[{low:.6g}, {high:.6g}]" for low, high in zip(*domain, strict=True))
    return f"the domain {' x '.join(edges)} m"


def place_outside(position: Sequence[float], lower: Sequence[float], upper: Sequence[float]) -> str:
    """A position [m] in words, with as many digits as it takes to see that a coordinate is not within the limits."""
    texts: list[str] = []
    for digits in (4, 7, 10, 17):
        texts = [f"{x:.{digits}g}" for x in position]
        if any(not low <= float(text) <= high for text, low, high in zip(texts, lower, upper, strict=True)):
            break
    return f"({', '.join(texts)})"


def why_failing(state: ParticleState, particle: int, limits: Domain = UNIT_BOX) -> str:
    """In words, what is wrong with a failing particle."""
    position = state.position[:, particle]
    if not bool(torch.isfinite(position).all() and torch.isfinite(state.deformation[:, :, particle]).all()):
        return "its state is not finite"
    if left_domain(state, particle, limits):
        return f"it left {domain_in_words(limits)} at {place_outside(position.tolist(), *limits)}"
    jacobian = float(determinant(state.deformation[:, :, particle : particle + 1])[0])
    return f"its deformation gradient turned inside out (det F = {jacobian:.3g})"
