"""A constitutive model as an AOTInductor package (.pt2): many particles at once, with tangents, without Python."""

import logging
import tempfile
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import torch
import torch._inductor
from torch import Tensor, nn
from torch.fx.experimental.proxy_tensor import make_fx

from pcnclaws.compiled.backend import using_backend
from pcnclaws.compiled.build import find_compiler
from pcnclaws.errors import UserError
from pcnclaws.laws.constitutive_model import ConstitutiveModel
from pcnclaws.laws.principal import without_a_look

# Particles of the inputs that the program is traced with: any number other than 0 and 1, which are special.
TRACED = 7


class LawProgram(nn.Module):
    """Plastic flow and stress after each other, with their derivatives: what an exported program computes.

    Each particle stands nine times in a batch, once for each component of a result: the derivatives are two backward
    passes.
    """

    def __init__(self, model: ConstitutiveModel) -> None:
        super().__init__()
        laws = model.laws_in(torch.float64, "cpu")
        self.elasticity, self.plasticity = laws.elasticity, laws.plasticity
        self.names = model.parameter_names
        if laws.internal_variables or (laws.plasticity is not None and laws.plasticity.reads_time_step):
            raise UserError(
                f"format=pt2: the law of {model.material.name} remembers or takes time; accepted: laws without "
                "internal variables and time, or format=cpp"
            )

    def forward(self, trial: Tensor, parameters: Tensor) -> tuple[Tensor, Tensor, Tensor, Tensor]:
        """F after plastic flow, tau of it, d F / d trial, d tau / d trial.

        trial       trial deformation gradient [-], (particles, 3, 3)
        parameters  physical parameters in the order of the material, (particles, parameters)
        returns     (particles, 3, 3) twice, (particles, 3, 3, 3, 3) twice
        """
        count = trial.shape[0]
        repeated = trial.permute(1, 2, 0).repeat(1, 1, 9)
        known = dict(zip(self.names, parameters.repeat(9, 1).unbind(1), strict=True))

        def answer(f: Tensor) -> tuple[Tensor, Tensor]:
            after = f if self.plasticity is None else self.plasticity.evaluate(f, known)[0]
            return after, self.elasticity.evaluate(after, known)[0]

        (after, stress), pull = torch.func.vjp(answer, repeated)[:2]
        chosen = torch.eye(9, dtype=trial.dtype).reshape(3, 3, 9, 1).expand(3, 3, 9, count).reshape(3, 3, 9 * count)
        nothing = torch.zeros_like(chosen)
        tangents = [pull(one)[0].reshape(3, 3, 9, count) for one in ((chosen, nothing), (nothing, chosen))]
        of_flow, of_stress = (one.permute(3, 2, 0, 1).reshape(count, 3, 3, 3, 3) for one in tangents)
        return after[:, :, :count].permute(2, 0, 1), stress[:, :, :count].permute(2, 0, 1), of_flow, of_stress


def program_package(model: ConstitutiveModel) -> bytes:
    """The package of a LawProgram for any number of particles, in double precision, on the CPU.

    raises  UserError without a C++ compiler, for laws that remember or take time, and where PyTorch cannot compile it
    """
    if find_compiler() is None:
        raise UserError("format=pt2 needs a C++ compiler (g++, or that of $CXX); accepted without: cpp, zip")
    exported = exported_program(model)
    with tempfile.TemporaryDirectory(prefix="pcnclaws-") as folder, _quietly():
        path = Path(folder) / "law.pt2"
        try:
            torch._inductor.aoti_compile_and_package(exported, package_path=str(path))
        except Exception as fault:  # whatever a compiler and PyTorch say
            reason = " ".join(str(fault).split())[:200] or type(fault).__name__
            raise UserError(f"format=pt2: PyTorch cannot compile the law ({reason}); accepted: cpp, zip") from fault
        return path.read_bytes()


@contextmanager
def _quietly() -> Iterator[None]:
    """Without what PyTorch says of itself while it compiles."""
    logging.disable(logging.WARNING)
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            yield
    finally:
        logging.disable(logging.NOTSET)


def exported_program(model: ConstitutiveModel) -> torch.export.ExportedProgram:
    """A LawProgram as torch.export has it, for any number of particles from 2 on."""
    program = LawProgram(model).requires_grad_(False)
    trial = torch.eye(3, dtype=torch.float64) + 0.01 * torch.arange(9.0, dtype=torch.float64).reshape(3, 3)
    middle = [0.5 * sum(model.ranges[name]) for name in program.names]
    given = (
        torch.stack([trial * (1.0 + 0.01 * k) for k in range(TRACED)]),
        torch.tensor([middle] * TRACED, dtype=torch.float64),
    )
    particles = torch.export.Dim("particles", min=2)
    # derivatives are written out first: torch.export does not differentiate
    with using_backend("torch"), without_a_look():
        program(*given)  # what laws compute once and keep is known before the trace
        graph = make_fx(program, tracing_mode="symbolic", _allow_non_fake_inputs=True)(*given)
    return torch.export.export(graph, given, dynamic_shapes=({0: particles}, {0: particles}), strict=False)
