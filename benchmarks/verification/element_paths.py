"""Deformation paths that laws are driven along through the public interface, in double precision."""

from collections.abc import Callable, Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import torch
from torch import Tensor

import pcnclaws as pc

REFERENCE = Path(__file__).parent / "reference"


def diagonal(*stretches: Any) -> Tensor:
    """Deformation gradients along fixed axes, (points, 3, 3), from three arrays of stretches."""
    columns = torch.broadcast_tensors(*(torch.as_tensor(one, dtype=torch.float64) for one in stretches))
    return torch.diag_embed(torch.stack(columns, dim=-1))


def simple_shear(amounts: np.ndarray) -> Tensor:
    """F = I + gamma e_1 e_2^T, (points, 3, 3)."""
    f = torch.eye(3, dtype=torch.float64).repeat(len(amounts), 1, 1)
    f[:, 0, 1] = torch.from_numpy(amounts)
    return f


def driven(
    law: pc.ConstitutiveModel,
    strains: np.ndarray,
    parameters: Mapping[str, Any],
    times: Sequence[float] | np.ndarray | None = None,
) -> np.ndarray:
    """Kirchhoff stresses [Pa] of a path of total Hencky strains along fixed axes, (points, 3).

    strains  [-], (points, 3), from an undeformed body on
    times    [s], (points,): of a law whose flow takes time
    """
    elastic, internal = torch.eye(3, dtype=torch.float64), None
    stresses, before = [], np.zeros(3)
    for k, strain in enumerate(strains):
        trial = diagonal(*np.exp(strain - before)) @ elastic
        elapsed = {} if times is None or k == 0 else {"dt": float(times[k] - times[k - 1])}
        before = strain
        if k or times is None:
            if law.internal_names:
                elastic, internal = law.return_map(trial, internal=internal, **elapsed, **parameters)
            else:
                elastic = law.return_map(trial, **elapsed, **parameters)
        stresses.append(_stress(law, elastic, internal, parameters).diagonal().numpy())
    return np.array(stresses)


def shipped_law(material: str) -> pc.ConstitutiveModel:
    """The law whose weights ship, in double precision."""
    return pc.load_law(material).double()


def _stress(law: pc.ConstitutiveModel, elastic: Tensor, internal: Any, parameters: Mapping[str, Any]) -> Tensor:
    reads = law.elasticity.internal_variables
    return law.stress(elastic, internal=internal if reads else None, **parameters)


def at_constant_lateral_stress(
    law: pc.ConstitutiveModel, axial: Iterable[float], lateral_stress: float, parameters: Mapping[str, Any]
) -> np.ndarray:
    """Principal Kirchhoff stresses [Pa] while the axial strain is driven and the lateral stress held, (points, 3).

    The body is first brought to an isotropic stress, then each increment of lateral strain is found by the secant
    method, as a testing machine would hold its cell pressure.

    axial  Hencky strains [-] beyond those of the isotropic state
    """
    elastic = diagonal(*3 * [torch.exp(torch.tensor(_isotropic_strain(law, lateral_stress, parameters)))])
    stresses, before, guess = [], 0.0, 0.0
    for strain in axial:

        def answer(lateral: float, step: float = strain - before, start: Tensor = elastic) -> Tensor:
            return law.return_map(diagonal(*np.exp([step, lateral, lateral])) @ start, **parameters)

        def excess(lateral: float, answer: Callable[[float], Tensor] = answer) -> float:
            return float(law.stress(answer(lateral), **parameters)[1, 1]) - lateral_stress

        guess = _secant(excess, guess, abs(strain - before))
        elastic, before = answer(guess), strain
        stresses.append(law.stress(elastic, **parameters).diagonal().numpy())
    return np.array(stresses)


def _isotropic_strain(law: pc.ConstitutiveModel, stress: float, parameters: Mapping[str, Any]) -> float:
    def excess(strain: float) -> float:
        return float(law.stress(diagonal(*np.exp(3 * [strain])), **parameters)[0, 0]) - stress

    return _secant(excess, 0.0, 1e-4) if stress else 0.0


def _secant(function: Callable[[float], float], start: float, step: float) -> float:
    """The root of a growing function, to the last digits."""
    left, right = start, start + step
    at_left, at_right = function(left), function(right)
    for _ in range(60):
        if at_right == at_left or abs(right - left) < 1e-15:
            break
        left, right, at_left = right, right - at_right * (right - left) / (at_right - at_left), at_right
        at_right = function(right)
    return right


def numbers_of(file: str) -> dict[str, np.ndarray]:
    """The columns of a reference file by name."""
    table = np.genfromtxt(REFERENCE / file, delimiter=",", names=True)
    return {name: table[name] for name in table.dtype.names or ()}
