"""Named tensor shapes. Inside the package tensors are component-first: the particles are the last dimension."""

from collections.abc import Mapping
from typing import TypeAlias

from jaxtyping import Bool, Float, Int64
from torch import Tensor

Scalars: TypeAlias = Float[Tensor, " particles"]
Vectors: TypeAlias = Float[Tensor, "3 particles"]
Matrices: TypeAlias = Float[Tensor, "3 3 particles"]
InternalValues: TypeAlias = Float[Tensor, "variables particles"]
SceneVectors: TypeAlias = Float[Tensor, "3 scenes"]
SceneIndex: TypeAlias = Int64[Tensor, " particles"]
ParticleMask: TypeAlias = Bool[Tensor, " particles"]

# Physical parameters by name (youngs_modulus [Pa], poissons_ratio [-], friction_angle [deg], yield_stress [Pa]),
# one value a particle.
Parameters: TypeAlias = Mapping[str, Tensor]
