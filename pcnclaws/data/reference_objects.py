"""Separation of training and test: whether a training scene would give away an object that laws are tested with."""

from collections.abc import Mapping

from pcnclaws.laws.materials import Material

# Training data keeps this relative distance from every reference object in at least one parameter.
NEIGHBOURHOOD = 0.03


def is_near_reference(parameters: Mapping[str, float], material: Material) -> bool:
    """Whether all parameters lie within NEIGHBOURHOOD of those of one reference object."""
    return any(
        all(abs(parameters[name] - value) <= NEIGHBOURHOOD * value for name, value in thing.parameters.items())
        for thing in material.objects
    )
