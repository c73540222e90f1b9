"""All cases of verification, by name, in the order of the page."""

from benchmarks.verification import (
    element_cone,
    element_elasticity,
    element_invariants,
    element_metals,
    element_neural,
    motion_bar,
    motion_bending,
    motion_collapse,
    motion_column,
    motion_energy,
    motion_plate,
    motion_rigid,
    motion_stretch,
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
    *motion_rigid.CASES,
    *motion_bar.CASES,
    *motion_stretch.CASES,
    *motion_column.CASES,
    *motion_plate.CASES,
    *motion_bending.CASES,
    *motion_energy.CASES,
    *motion_collapse.CASES,
    *not_had.CASES,
]
CASES: dict[str, Case] = {case.name: case for case in _ALL}
