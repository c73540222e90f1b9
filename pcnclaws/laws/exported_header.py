"""A constitutive model as one C++ header: value and consistent tangent in double precision, weights inside."""

import re
from collections.abc import Sequence

import numpy as np
import torch

from pcnclaws.compiled.coefficient_source import coefficient_source
from pcnclaws.compiled.header_source import HeaderLaw, HeaderModel, law_header
from pcnclaws.compiled.symbols import Untraceable
from pcnclaws.errors import UserError
from pcnclaws.laws.constitutive_model import ConstitutiveModel
from pcnclaws.laws.formulas import TIME_STEP
from pcnclaws.laws.internal_variables import InternalVariable
from pcnclaws.laws.law import Law
from pcnclaws.laws.networks import ConditionalMLP
from pcnclaws.laws.parameters import Parameter

PREFIX = "pcnclaws_"


def header_text(model: ConstitutiveModel, name: str, comment: Sequence[str] = ()) -> str:
    """The text of a C++17 header without dependencies, checked against PyTorch to rounding.

    name     of the namespace, behind 'pcnclaws_': other signs than letters, digits and _ become _
    comment  lines at its top
    raises   UserError for laws without kernels, which no header is made of
    """
    laws, variables = model.laws_in(torch.float64, "cpu"), model.laws.internal_variables
    plastic = None if laws.plasticity is None else _header_law(laws.plasticity, variables)
    parameters = {one.name: (_middle(model, one), _words(model, one)) for one in model.physical_parameters}
    return law_header(
        HeaderModel(
            PREFIX + re.sub(r"\W", "_", name, flags=re.ASCII),
            comment,
            parameters,
            {one.name: one.start for one in variables},
            _header_law(laws.elasticity, variables),
            plastic,
        )
    )


def _header_law(law: Law, variables: Sequence[InternalVariable]) -> HeaderLaw:
    kind, kernel = type(law).__name__, law.kernel
    if kernel is None:
        raise UserError(
            f"format=cpp: the law {kind} has no kernel, of which headers are made; accepted: laws that are functions "
            "of principal strains"
        )
    read = {name: f"p.{name}" for name in law.parameter_names}
    try:
        coefficients = coefficient_source(law.kernel_rows, {**read, TIME_STEP: TIME_STEP})
    except Untraceable as fault:
        raise UserError(f"format=cpp: the law {kind}: {fault}") from fault
    places = [variables.index(one) for one in law.internal_variables]
    return HeaderLaw(kernel, coefficients, _weights(law), places)


def _weights(law: Law) -> list[tuple[np.ndarray, np.ndarray]]:
    """Matrices and biases of the layers of the law's network, none without one."""
    network = getattr(law, "network", None)
    if not isinstance(network, ConditionalMLP):
        return []
    layers = zip(network.weights, network.biases, strict=True)
    return [(weight.detach().numpy(), bias.detach().numpy()[:, 0]) for weight, bias in layers]


def _middle(model: ConstitutiveModel, parameter: Parameter) -> float:
    low, high = model.ranges[parameter.name]
    return 0.5 * (low + high)


def _words(model: ConstitutiveModel, parameter: Parameter) -> str:
    low, high = model.ranges[parameter.name]
    span = f"{'trained from' if model.is_trained else 'usual:'} {low:g} to {high:g}"
    return f"[{parameter.unit}], {parameter.accepted}; {span}"
