"""All cases of verification, by name, in the order of the page."""

from benchmarks.verification import (
    element_cone,
    element_elasticity,
    element_invariants,
    element_metals,
    element_neural,
    not_had,
)
from benchmarks.verification.case import Case

_ALL = [
    *element_cone.CASES,
    *element_neural.CASES,
    *element_metals.CASES,
    *element_elasticity.CASES,
    *element_invariants.CASES,
    *element_neural.NEURAL_CASES,
    *element_invariants.NEURAL_CASES,
    *not_had.CASES,
]
CASES: dict[str, Case] = {case.name: case for case in _ALL}
