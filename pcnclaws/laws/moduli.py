"""Moduli that follow from the physical parameters."""

from pcnclaws.tensors.tensor_types import Parameters, Scalars


def lame_constants(parameters: Parameters) -> tuple[Scalars, Scalars]:
    """Lame's lambda and the shear modulus mu [Pa], from youngs_modulus and poissons_ratio."""
    youngs_modulus, poissons_ratio = parameters["youngs_modulus"], parameters["poissons_ratio"]
    mu = youngs_modulus / (2.0 * (1.0 + poissons_ratio))
    return 2.0 * mu * poissons_ratio / (1.0 - 2.0 * poissons_ratio), mu
