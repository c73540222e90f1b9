"""What every law must obey: objectivity, isotropy, symmetry, dissipation, and returns that are final."""

from collections.abc import Callable, Mapping, Sequence
from functools import partial
from typing import Any, NamedTuple

import torch
from torch import Tensor

import pcnclaws as pc
from benchmarks.verification.case import Case, Outcome, Table, violation
from benchmarks.verification.element_paths import shipped_law

COUNT = 200
BUILT_IN = ("elasticity", "neo_hookean", "plasticine", "tresca", "sand")
SHIPPED = ("elasticity", "plasticine", "sand")
# Largest entry of the random Hencky strains: of a body at rest, in motion, and crushed.
SIZES = (0.002, 0.02, 0.2)


class Sample(NamedTuple):
    """Random deformations of one size (COUNT, 3, 3), a random rotation for each, and the parameters of the law."""

    law: pc.ConstitutiveModel
    deformation: Tensor
    rotation: Tensor
    parameters: Mapping[str, Any]

    @property
    def stress_scale(self) -> float:
        """E times the size of the strains [Pa]."""
        size = float(_log(self.deformation @ self.deformation.mT).norm(dim=(1, 2)).max()) / 2.0
        return self.parameters["youngs_modulus"] * size

    def stress(self, deformation: Tensor) -> Tensor:
        return self.law.stress(deformation, **self.parameters).detach()

    def returned(self, trial: Tensor) -> Tensor:
        return self.law.return_map(trial, **self.parameters).detach()


def objectivity(sample: Sample) -> float:
    """|tau(Q F) - Q tau(F) Q^T| / (E |h|), and |F_e(Q F) - Q F_e(F)| / |h|."""
    f, q = sample.deformation, sample.rotation
    stress = sample.stress(q @ f) - q @ sample.stress(f) @ q.mT
    elastic = sample.returned(q @ f) - q @ sample.returned(f)
    return _relative(sample, stress, elastic)


def isotropy(sample: Sample) -> float:
    """|tau(F Q) - tau(F)| / (E |h|), and |F_e(F Q) - F_e(F) Q| / |h|."""
    f, q = sample.deformation, sample.rotation
    return _relative(sample, sample.stress(f @ q) - sample.stress(f), sample.returned(f @ q) - sample.returned(f) @ q)


def symmetry(sample: Sample) -> float:
    """|tau - tau^T| / (E |h|)."""
    stress = sample.stress(sample.deformation)
    return _relative(sample, stress - stress.mT)


def dissipation(sample: Sample) -> float:
    """Negative part of tau(F_e) : (h - h_e) / (E |h|^2), h the strain before and h_e the one after the return."""
    trial = sample.deformation
    elastic = sample.returned(trial)
    plastic = 0.5 * (_log(trial @ trial.mT) - _log(elastic @ elastic.mT))
    work = (sample.stress(elastic) * plastic).sum((1, 2))
    size = sample.stress_scale**2 / sample.parameters["youngs_modulus"]
    return max(0.0, -float(work.min()) / size)


def finality(sample: Sample) -> float:
    """|F_e(F_e(F)) - F_e(F)| / |h|: a second return changes nothing."""
    elastic = sample.returned(sample.deformation)
    return _relative(sample, torch.zeros(1, 1), sample.returned(elastic) - elastic)


def _relative(sample: Sample, stress: Tensor, elastic: Tensor | None = None) -> float:
    error = float(stress.norm(dim=(-2, -1)).max()) / sample.stress_scale
    if elastic is not None:
        strain = sample.stress_scale / sample.parameters["youngs_modulus"]
        error = max(error, float(elastic.norm(dim=(-2, -1)).max()) / strain)
    return error


def samples(law: pc.ConstitutiveModel) -> list[Sample]:
    """Random deformations of all sizes, the parameters in the middle of their ranges."""
    generator = torch.Generator().manual_seed(3)
    middle = {name: 0.5 * (low + high) for name, (low, high) in law.ranges.items()}
    drawn = []
    for size in SIZES:
        general = size * (2.0 * torch.rand(COUNT, 3, 3, dtype=torch.float64, generator=generator) - 1.0)
        turns = [_rotations(generator) for _ in range(2)]
        deformation = torch.linalg.matrix_exp(0.5 * (general + general.mT)) @ turns[0]
        drawn.append(Sample(law, deformation, turns[1], middle))
    return drawn


def _rotations(generator: torch.Generator) -> Tensor:
    q, _ = torch.linalg.qr(torch.randn(COUNT, 3, 3, dtype=torch.float64, generator=generator))
    return q * torch.linalg.det(q)[:, None, None]


def _log(b: Tensor) -> Tensor:
    values, vectors = torch.linalg.eigh(b)
    return vectors @ torch.diag_embed(values.log()) @ vectors.mT


def worst(measure: Callable[[Sample], float], laws: Mapping[str, Callable[[], Any]]) -> Outcome:
    """The largest violation over laws and sizes, and a table of all."""
    errors = {name: [measure(sample) for sample in samples(law())] for name, law in laws.items()}
    lines = [[name, *(f"{error:.1e}" for error in of_law)] for name, of_law in errors.items()]
    header = ["", *(f"strains to {size:g}" for size in SIZES)]
    return violation(max(max(of_law) for of_law in errors.values()), table=Table(header, lines))


NOT_FINAL = (
    "The learned yield surface has a width: a return from far outside stops up to 0.01 of the strain short of where it "
    "would end, the second return moves 0.3 to 1 % of the trial strain, the third 100 times less. A motion comes back "
    "in every step."
)


class Property(NamedTuple):
    """A property: its measure, the sentence, and tolerances of written and of learned laws."""

    measure: Callable[[Sample], float]
    sentence: str
    written: float
    learned: float


PROPERTIES = {
    "objectivity": Property(objectivity, "Turning a deformed body turns its stress and its elastic strain", 1e-9, 1e-4),
    "isotropy": Property(isotropy, "Turning a body before it is deformed changes neither stress nor flow", 1e-9, 1e-4),
    "symmetry": Property(symmetry, "Stress is symmetric", 1e-12, 1e-12),
    "dissipation": Property(
        dissipation, "Plastic flow never gives energy: its dissipation is not negative", 1e-12, 1e-6
    ),
    "finality": Property(finality, "A return to the yield surface is final: a second one changes nothing", 1e-9, 1e-3),
}


def _cases(names: Sequence[str], shipped: bool) -> list[Case]:
    of, load = ("shipped neural", shipped_law) if shipped else ("analytic", pc.analytic_law)
    laws = {name: partial(load, name) for name in names}
    return [
        Case(
            f"neural_{name}" if shipped else name,
            "neural laws" if shipped else "laws",
            f"{one.sentence} ({len(laws)} {of} laws, {COUNT} random strains of 3 sizes).",
            "frame indifference and isotropy" if name in ("objectivity", "isotropy", "symmetry") else "thermodynamics",
            one.learned if shipped else one.written,
            partial(worst, one.measure, laws),
            why=NOT_FINAL if shipped and name == "finality" else "",
        )
        for name, one in PROPERTIES.items()
    ]


CASES = _cases(BUILT_IN, shipped=False)
NEURAL_CASES = _cases(SHIPPED, shipped=True)
