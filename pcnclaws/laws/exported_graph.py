"""A constitutive model as an ONNX graph: plastic flow and stress of many particles, without derivatives."""

import logging
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from importlib.util import find_spec
from typing import Any

import numpy as np
import torch
from numpy.polynomial.chebyshev import chebfit, chebpts1
from scipy.special import erfcx
from torch import Tensor, fx, nn
from torch.fx.experimental.proxy_tensor import make_fx

from pcnclaws.compiled.backend import using_backend
from pcnclaws.errors import UserError, not_installed
from pcnclaws.laws.constitutive_model import ConstitutiveModel
from pcnclaws.tensors.tensor_types import Parameters

INPUTS, OUTPUTS = ("trial", "parameters"), ("elastic", "stress")
# Sweeps of Jacobi rotations, which converge quadratically.
SWEEPS = 6
# Particles of the inputs that the graph is traced with: any number other than 0 and 1, which are special.
TRACED = 7
# Where 1 - erf vanishes to the last bit, and the degree of the polynomial that gives it.
LARGEST, DEGREE = 6.0, 24
aten = torch.ops.aten


class LawValues(nn.Module):
    """Plastic flow and stress after each other, by operations that ONNX has.

    It has no eigenvalue decomposition: the principal axes are found by a fixed number of one-sided Jacobi rotations.
    """

    def __init__(self, model: ConstitutiveModel) -> None:
        super().__init__()
        laws = model.laws_in(torch.float64, "cpu")
        self.elasticity, self.plasticity = laws.elasticity, laws.plasticity
        self.names = model.parameter_names
        if laws.internal_variables or (laws.plasticity is not None and laws.plasticity.reads_time_step):
            raise UserError(
                f"format=onnx: the law of {model.material.name} remembers or takes time; accepted: laws without "
                "internal variables and time, or format=cpp"
            )
        for law in (laws.elasticity, laws.plasticity):
            if law is not None and not law.is_principal:
                raise UserError(
                    f"format=onnx: the law {type(law).__name__} is not a function of principal strains, of which "
                    "graphs are made; accepted: laws that are, or format=zip"
                )

    def forward(self, trial: Tensor, parameters: Tensor) -> tuple[Tensor, Tensor]:
        """F after plastic flow, and tau of it [Pa], each (particles, 3, 3).

        trial       trial deformation gradient [-], (particles, 3, 3); NaN is returned where its determinant is not > 0
        parameters  physical parameters in the order of the material, (particles, parameters)
        """
        known: Parameters = dict(zip(self.names, parameters.unbind(1), strict=True))
        q, g = _principal_axes(trial)
        upright = (torch.linalg.cross(trial[:, 0], trial[:, 1]) * trial[:, 2]).sum(1) > 0.0
        strain = torch.where(upright[:, None], 0.5 * g.square().sum(2).log(), torch.nan).T
        after, elastic = strain, trial.clone()  # an input that is a result, too, would lose its name
        if self.plasticity is not None:
            after = self.plasticity.response(known)(strain)[:3]
            elastic = trial + q @ ((after - strain).expm1().T[:, :, None] * g)
        stress = self.elasticity.response(known)(after)
        return elastic, (q * stress.T[:, None, :]) @ q.mT


def _principal_axes(f: Tensor) -> tuple[Tensor, Tensor]:
    """Q and G with F = Q G, Q orthogonal, the rows of G orthogonal to each other (Hestenes 1958)."""
    columns, rows = list(torch.eye(3, dtype=f.dtype).expand_as(f).unbind(2)), list(f.unbind(1))
    for _ in range(SWEEPS):
        for i, j in ((0, 1), (0, 2), (1, 2)):
            cosine, sine = _turn(rows[i], rows[j])
            for vectors in (rows, columns):
                first, second = vectors[i], vectors[j]
                vectors[i], vectors[j] = cosine * first - sine * second, cosine * second + sine * first
    return torch.stack(columns, 2), torch.stack(rows, 1)


def _turn(first: Tensor, second: Tensor) -> tuple[Tensor, Tensor]:
    """Cosine and sine, (particles, 1), of the rotation that makes two rows orthogonal."""
    alpha, beta, gamma = ((a * b).sum(1, keepdim=True) for a, b in ((first, first), (second, second), (first, second)))
    turns = gamma.abs() > 1e-16 * alpha.sqrt() * beta.sqrt()
    cotangent = (beta - alpha) / torch.where(turns, 2.0 * gamma, 1.0)
    size = cotangent.abs() + (1.0 + cotangent.square()).sqrt()
    tangent = torch.where(turns, torch.where(cotangent < 0.0, -1.0, 1.0) / size, 0.0)
    cosine = (1.0 + tangent.square()).sqrt().reciprocal()
    return cosine, cosine * tangent


def onnx_graph(model: ConstitutiveModel) -> bytes:
    """The ONNX file of LawValues for any number of particles, in double precision.

    raises  UserError without the packages onnx and onnxscript, for laws that remember or take time, and for those that
            are not functions of principal strains
    """
    if find_spec("onnx") is None:
        raise not_installed("format=onnx", "onnx", "onnx", "cpp, pt2, zip")
    if find_spec("onnxscript") is None:
        raise not_installed("format=onnx", "onnxscript", "onnx", "cpp, pt2, zip")
    program, given = LawValues(model).requires_grad_(False), _example(model)
    particles = torch.export.Dim("particles", min=2)
    shapes = ({0: particles}, {0: particles})
    with using_backend("torch"), _quietly():
        program(*given)  # what laws compute once and keep is known before the trace
        # derivatives of energies are written out first: neither torch.export nor ONNX differentiates
        tracing = make_fx(program, decomposition_table=SIMPLER, tracing_mode="symbolic", _allow_non_fake_inputs=True)
        graph = _with_precise_numbers(tracing(*given))
        exported = torch.export.export(graph, given, dynamic_shapes=shapes, strict=False)
        # not optimised: that takes numbers below 1e-8 for zero
        made = torch.onnx.export(
            exported, dynamo=True, optimize=False, input_names=INPUTS, output_names=OUTPUTS, verbose=False
        )
    if made is None:
        raise UserError(f"format=onnx: PyTorch makes no graph of the law of {model.material.name}; accepted: cpp, zip")
    return _without_notes(made.model_proto).SerializeToString()


def _example(model: ConstitutiveModel) -> tuple[Tensor, Tensor]:
    trial = torch.eye(3, dtype=torch.float64) + 0.01 * torch.arange(9.0, dtype=torch.float64).reshape(3, 3)
    middle = [0.5 * sum(model.ranges[name]) for name in model.parameter_names]
    return (
        torch.stack([trial * (1.0 + 0.01 * k) for k in range(TRACED)]),
        torch.tensor([middle] * TRACED, dtype=torch.float64),
    )


def _softplus(x: Tensor, beta: float | int = 1, threshold: float | int = 20) -> Tensor:
    return x.clamp_min(0.0) + (1.0 + (-x.abs()).exp()).log()


def gelu(x: Tensor, approximate: str = "none") -> Tensor:
    """x (1 + erf(x / sqrt(2))) / 2, by a polynomial in t = 2/(2 + z) times t e^(-z^2), z = |x| / sqrt(2).

    Runtimes have the error function in single precision alone.
    """
    z = (x.abs() * 0.5**0.5).clamp_max(LARGEST)
    t = 2.0 / (2.0 + z)
    least = 2.0 / (2.0 + LARGEST)
    u = (2.0 * t - (1.0 + least)) / (1.0 - least)
    rest, before = torch.zeros_like(x), torch.zeros_like(x)
    points = chebpts1(DEGREE + 1)
    coefficients = chebfit(points, _scaled_erfc(0.5 * (points * (1.0 - least) + 1.0 + least)), DEGREE)
    for coefficient in coefficients[:0:-1]:  # Clenshaw's recurrence
        rest, before = 2.0 * u * rest - before + float(coefficient), rest
    beyond = 0.5 * (t * (u * rest - before + float(coefficients[0]))) * (-z * z).exp()
    return x * torch.where(x > 0.0, 1.0 - beyond, beyond)


def _scaled_erfc(t: np.ndarray) -> np.ndarray:
    return erfcx(2.0 / t - 2.0) / t


def _clamped(x: Tensor, low: float | int | None = None, high: float | int | None = None) -> Tensor:
    """Bounds as sums, whose numbers are kept in double precision."""
    above = x if low is None else torch.maximum(x, torch.zeros_like(x) + low)
    return above if high is None else torch.minimum(above, torch.zeros_like(x) + high)


# What runtimes have no operator for in double precision.
SIMPLER = {
    aten.clamp.default: _clamped,
    aten.clamp_min.default: _clamped,
    aten.clamp_max.default: lambda x, high: _clamped(x, None, high),
    aten.softplus.default: _softplus,
    aten.gelu.default: gelu,
    aten.full_like.default: lambda like, value, **_: torch.zeros_like(like) + value,
}


def _with_precise_numbers(graph: fx.GraphModule) -> fx.GraphModule:
    """The graph with the numbers of its sums and products as tensors: ONNX has others in single precision."""
    for node in list(graph.graph.nodes):
        for place, value in enumerate(node.args):
            if isinstance(value, float) and "Tensor" in str(node.target) and value != float(np.float32(value)):
                name = f"number_{len(dict(graph.named_buffers()))}"
                graph.register_buffer(name, torch.tensor(value, dtype=torch.float64))
                with graph.graph.inserting_before(node):
                    node.update_arg(place, graph.graph.get_attr(name))
    graph.recompile()
    return graph


@contextmanager
def _quietly() -> Iterator[None]:
    """Without what PyTorch says of itself."""
    logging.disable(logging.WARNING)
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            yield
    finally:
        logging.disable(logging.NOTSET)


def _without_notes(model: Any) -> Any:
    """The file without what PyTorch notes of the lines of code that each operation comes from."""
    del model.metadata_props[:]
    for one in (model.graph, *model.graph.node, *model.graph.input, *model.graph.output, *model.graph.value_info):
        del one.metadata_props[:]
        one.doc_string = ""
    return model
