"""Laws of measured stress: python -m benchmarks.real_stress docs/measured docs/results/real_stress.json.

Trains the law of each foam and the one of the rubbers, trains the latter again without each of its loading paths, and
fits the laws of textbooks to the same paths. Goes on where it was interrupted.
"""

import json
import sys
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import torch
from scipy.optimize import minimize_scalar

from pcnclaws.atomic import replaced_file
from pcnclaws.commands.composition import compose_config
from pcnclaws.commands.models import build_model
from pcnclaws.commands.stress_report import path_rows
from pcnclaws.commands.stress_setup import StressData, stress_data
from pcnclaws.data.loading_paths import LoadingPath
from pcnclaws.laws.base import Elasticity
from pcnclaws.laws.elasticity import FixedCorotated, NeoHookean, StVKHencky
from pcnclaws.laws.materials import material_named
from pcnclaws.provenance import provenance
from pcnclaws.training.principal_paths import PrincipalPaths, Response, principal_paths, with_free_sides
from pcnclaws.training.stress_fit import StressFit, StressProblem, fit_stress, relative_errors

FOAMS = ("leap", "turbo")
# Iterations of the trainings without one path, which start afresh.
ITERATIONS = 40
# Shears that the laws of foams are asked for, of which nothing was measured here, and Poisson's ratios to compare.
SHEARS, RATIOS = (0.1, 0.2, 0.3, 0.4, 0.5), (0.0, 0.1, 0.2, 0.3)


def main() -> None:
    """The command."""
    measured, output = map(Path, sys.argv[1:3])
    found: dict[str, Any] = json.loads(output.read_text()) if output.is_file() else {}
    torch.set_num_threads(1)

    def keep(name: str, make: Callable[[], Any]) -> None:
        if name not in found:
            started = time.monotonic()
            found[name] = make()
            found[name]["seconds"] = round(time.monotonic() - started, 1)
            with replaced_file(output) as part:
                part.write(json.dumps(found, indent=1).encode())
            print(f"{name}: {found[name]['seconds']} s", flush=True)

    found.setdefault("provenance", provenance(0, torch.device("cpu")))
    for foam in FOAMS:
        keep(f"foam {foam}", lambda foam=foam: _foam(measured, foam))
    rubbers = stress_data(_config("measured_rubbers", measured / "rubber" / "hyperelastic.h5"))
    keep("rubbers", lambda: _trained(rubbers, 100) | {"textbook": _textbook(rubbers)})
    for path in sorted(rubbers.paths, key=lambda path: path.specimen.startswith("brain")):
        keep(f"without {path.name}", lambda path=path: _without(rubbers, path))


def _config(experiment: str, *files: Path) -> Any:
    return compose_config("train", [f"experiment={experiment}", f"data.stress=[{','.join(map(str, files))}]"])


def _foam(measured: Path, foam: str) -> dict[str, Any]:
    files = [measured / "foam" / f"foam_{foam}_{test}.csv" for test in ("UT", "UC")]
    data = stress_data(_config("measured_foam", *files))
    shear = {}
    for ratio in RATIOS:
        with_ratio = StressData(data.paths, data.specimens, ratio, ())
        fitted, problem, unknowns = _fit(with_ratio, 150)
        shear[str(ratio)] = {
            "relative_rms": relative_errors(problem.paths, fitted.predicted),
            "stress": _simple_shear(problem, unknowns),
        }
    return _trained(data, 150) | {"textbook": _textbook(data), "shear": list(SHEARS), "simple_shear": shear}


def _simple_shear(problem: StressProblem, unknowns: torch.Tensor) -> list[float]:
    """P12 [Pa] of F = I + gamma e1 e2 at SHEARS."""
    deformation = np.tile(np.eye(3), (len(SHEARS), 1, 1))
    deformation[:, 0, 1] = SHEARS
    stress = np.full_like(deformation, np.nan)
    stress[:, 0, 1] = 1.0
    path = LoadingPath("shear", problem.names[0], deformation, np.zeros(3, bool), stress, False)
    sheared = StressProblem(
        problem.law, principal_paths([path], problem.names, False), problem.names, problem.poissons_ratio
    )
    sheared.reach = problem.reach
    return (sheared.predicted(unknowns) * sheared.paths.size).tolist()


def _fit(data: StressData, iterations: int) -> tuple[StressFit, StressProblem, torch.Tensor]:
    torch.manual_seed(0)
    laws = build_model(material_named("elasticity"), {"name": "pcnclaws_stretches", "width": 12}).laws
    paths = principal_paths(data.paths, data.specimens, data.is_incompressible)
    problem = StressProblem(laws.elasticity.double(), paths, data.specimens, data.poissons_ratio)  # pyright: ignore
    fitted = fit_stress(problem, problem.start(0), iterations)
    return fitted, problem, fitted.unknowns


def _trained(data: StressData, iterations: int) -> dict[str, Any]:
    fitted, problem, _ = _fit(data, iterations)
    specimens = [
        {"name": one.name, "youngs_modulus": one.youngs_modulus, "scale": float(np.exp(one.scale)), "shape": one.shape}
        for one in fitted.specimens
    ]
    return {"paths": path_rows(data.paths, problem.paths, fitted), "specimens": specimens}


def _without(data: StressData, left: LoadingPath) -> dict[str, Any]:
    paths = [path._replace(weight=0.0) if path.name == left.name else path for path in data.paths]
    if not any(path.weight > 0.0 and path.specimen == left.specimen for path in paths):
        return {"relative_rms": None}
    fitted, problem, _ = _fit(StressData(paths, data.specimens, data.poissons_ratio, ()), ITERATIONS)
    rows = path_rows(paths, problem.paths, fitted)
    return next({"relative_rms": row["relative_rms"], "row": row} for row in rows if row["name"] == left.name)


def _textbook(data: StressData) -> dict[str, dict[str, float]]:
    """Relative RMS of each path by laws of one or two parameters, fitted to the paths of each specimen."""
    found: dict[str, dict[str, float]] = {}
    for specimen in data.specimens:
        own = [path for path in data.paths if path.specimen == specimen]
        paths = principal_paths(own, [specimen], data.is_incompressible)
        laws = _incompressible(paths) if data.is_incompressible else _compressible(paths)
        for law, predicted in laws.items():
            errors = relative_errors(paths, predicted)
            found.setdefault(law, {}).update({path.name: error for path, error in zip(own, errors, strict=True)})
    return found


def _incompressible(paths: PrincipalPaths) -> dict[str, torch.Tensor]:
    def column(exponent: float) -> torch.Tensor:
        slope = paths.strain if abs(exponent) < 1e-9 else torch.expm1(exponent * paths.strain) / exponent
        return paths.predicted(Response(paths.strain, slope, torch.zeros(0)))

    def ogden(exponent: float) -> torch.Tensor:
        return _best(paths, [column(exponent)])

    tried = np.concatenate((np.linspace(-40.0, -2.0, 20), np.linspace(-1.5, 12.0, 28)))
    start = min(tried, key=lambda exponent: _loss(paths, ogden(float(exponent))))
    better: Any = minimize_scalar(
        lambda exponent: _loss(paths, ogden(exponent)), bounds=(start - 2.0, start + 2.0), method="bounded"
    )
    return {
        "neo-Hookean": _best(paths, [column(2.0)]),
        "Hencky": _best(paths, [column(0.0)]),
        "Mooney-Rivlin": _best(paths, [column(2.0), column(-2.0)]),
        "Ogden, one term": ogden(float(better.x)),
    }


def _compressible(paths: PrincipalPaths) -> dict[str, torch.Tensor]:
    """E and nu from 0 to 0.45 of the analytic laws."""
    laws: dict[str, Elasticity] = {"Hencky": StVKHencky(), "neo-Hookean": NeoHookean(), "corotated": FixedCorotated()}
    found = {}
    for name, law in laws.items():
        tried = [_best(paths, [_of_law(paths, law, ratio)]) for ratio in np.linspace(0.0, 0.45, 19)]
        found[name] = min(tried, key=lambda predicted: _loss(paths, predicted))
    return found


def _of_law(paths: PrincipalPaths, law: Elasticity, ratio: float) -> torch.Tensor:
    mu = 0.5 / (1.0 + ratio)
    known = SimpleNamespace(mu=mu, lam=2.0 * mu * ratio / (1.0 - 2.0 * ratio))

    def stress(strain: torch.Tensor) -> torch.Tensor:
        return torch.stack(list(law.principal_stress(strain.unbind(0), known)))

    def response(strain: torch.Tensor) -> Response:
        columns = [
            torch.func.jvp(stress, (strain,), (torch.eye(3).double()[k][:, None].expand_as(strain),))[1]
            for k in range(3)
        ]
        return Response(strain, stress(strain), torch.stack(columns).permute(2, 1, 0))

    return paths.predicted(with_free_sides(response, paths))


def _best(paths: PrincipalPaths, columns: Sequence[torch.Tensor]) -> torch.Tensor:
    matrix = torch.stack(list(columns), 1)
    return matrix @ torch.linalg.lstsq(matrix, paths.measured[:, None]).solution[:, 0]


def _loss(paths: PrincipalPaths, predicted: torch.Tensor) -> float:
    return float((predicted - paths.measured).square().sum())


if __name__ == "__main__":
    main()
