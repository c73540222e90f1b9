"""Simulations with laws of measured stress: python -m benchmarks.real_stress_scenes FOAM SHEET RESULT.json IMAGES.

A ball of foam is thrown on the floor; a sheet of rubber is drawn out by its ends. FOAM and
SHEET are run folders of `train data.stress=`; numbers go to the result, pictures to the folder of images.
"""

import json
import sys
from pathlib import Path
from typing import Any

import torch

import pcnclaws as pc
from pcnclaws.atomic import replaced_file
from pcnclaws.provenance import provenance

GRAVITY = 9.8
# Densities were not published: that of a light foam, and of rubber [kg/m^3].
FOAM_DENSITY, RUBBER_DENSITY = 200.0, 1000.0
# Of the rubbers, which are incompressible: what the grid carries without locking.
RUBBER_RATIO = 0.45


def main() -> None:
    """The command."""
    foam, sheet, output, images = map(Path, sys.argv[1:5])
    found = {
        "provenance": provenance(0, torch.device("cpu")),
        "ball": _ball(foam, images),
        "sheet": _sheet(sheet, images),
    }
    with replaced_file(output) as part:
        part.write(json.dumps(found, indent=1).encode())
    print(json.dumps(found, indent=1))


def _law(run: Path) -> tuple[pc.ConstitutiveModel, float, float]:
    law = pc.load_law(run)
    (modulus, _), (ratio, highest) = law.ranges["youngs_modulus"], law.ranges["poissons_ratio"]
    return law, modulus, ratio if ratio == highest else RUBBER_RATIO


def _ball(run: Path, images: Path) -> dict[str, Any]:
    law, modulus, ratio = _law(run)
    body = pc.Body.sphere(side=0.3, centre=(0.5, 0.3, 0.5), particles_per_edge=10)
    settings = pc.Settings(time_step="auto", density=FOAM_DENSITY)
    scene = pc.Scene(body, law, velocity=(0, -6.0, 0), youngs_modulus=modulus, poissons_ratio=ratio, settings=settings)
    motion = scene.simulate(steps=400, every=10, deformation=True)
    motion.save(images / "real_stress_ball.png")
    height, speed = motion.position[:, :, 1].mean(1), motion.velocity.square().sum(2).mean(1)
    moving = 0.5 * speed + GRAVITY * height
    return _state(motion) | {
        "energy_gained": float(moving.max() / moving[0] - 1.0),
        "speed_after_over_before": float(motion.velocity[:, :, 1].mean(1).max() / 6.0),
        "youngs_modulus": modulus,
    }


def _sheet(run: Path, images: Path) -> dict[str, Any]:
    law, modulus, ratio = _law(run)
    x, y, z = (torch.arange(n) for n in (24, 12, 4))
    grid = torch.cartesian_prod(x, y, z).double() * 0.0125 + torch.tensor([0.35, 0.425, 0.475])
    body = pc.Body.points(grid, torch.full((len(grid),), 0.0125**3).double())
    pull = 1.0  # m/s at each end
    ends = [
        pc.Collider.box(low=(low, 0.3, 0.3), high=(high, 0.7, 0.7), contact="sticky", velocity=(way * pull, 0, 0))
        for low, high, way in ((0.2, 0.375, -1.0), (0.6125, 0.8, 1.0))
    ]
    settings = pc.Settings(time_step=1e-4, domain=None, grid_spacing=0.025, gravity=(0, 0, 0), density=RUBBER_DENSITY)
    scene = pc.Scene(body, law, youngs_modulus=modulus, poissons_ratio=ratio, settings=settings, colliders=ends)
    motion = scene.simulate(steps=1000, every=100, deformation=True)
    motion.save(images / "real_stress_sheet.png")
    middle = _deformation(motion)[-1, (grid[:, 0] - 0.49).abs() < 0.03]
    return _state(motion) | {
        "stretch_in_the_middle": float(middle[:, 0, 0].mean()),
        "sides_in_the_middle": [float(middle[:, k, k].mean()) for k in (1, 2)],
        "youngs_modulus": modulus,
        "poissons_ratio": ratio,
    }


def _deformation(motion: pc.Motion) -> torch.Tensor:
    if motion.deformation is None:
        raise ValueError("the motion was recorded without F")
    return motion.deformation


def _state(motion: pc.Motion) -> dict[str, Any]:
    determinant = torch.linalg.det(_deformation(motion))
    return {
        "seconds": float(motion.time[-1]),
        "particles": motion.position.shape[1],
        "finite": bool(torch.isfinite(motion.position).all()),
        "least_det_f": float(determinant.min()),
        "largest_det_f": float(determinant.max()),
    }


if __name__ == "__main__":
    main()
