"""All cases of verification, by name, in the order of the page."""

from benchmarks.verification import (
    element_cone,
    element_elasticity,
    element_invariants,
    element_metals,
    element_neural,
    element_viscoelastic,
    motion_bar,
    motion_bending,
    motion_collapse,
    motion_column,
    motion_energy,
    motion_manufactured,
    motion_plate,
    motion_rest,
    motion_rigid,
    motion_stretch,
    not_had,
)
from benchmarks.verification.case import Case

_ALL = [
    *element_cone.CASES,
    *element_neural.CASES,
    *element_metals.CASES,
    *element_viscoelastic.CASES,
    *element_elasticity.CASES,
    *element_invariants.CASES,
    *element_neural.NEURAL_CASES,
    *element_invariants.NEURAL_CASES,
    *motion_rigid.CASES,
    *motion_bar.CASES,
    *motion_manufactured.CASES,
    *motion_stretch.CASES,
    *motion_column.CASES,
    *motion_plate.CASES,
    *motion_bending.CASES,
    *motion_energy.CASES,
    *motion_collapse.CASES,
    *motion_rest.CASES,
    *not_had.CASES,
]
CASES: dict[str, Case] = {case.name: case for case in _ALL}
