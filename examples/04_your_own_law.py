"""A law of one's own, from a function to a motion: a metal that hardens: python examples/04_your_own_law.py

Its kernel, with derivatives, is made from the function. Leaves a picture in outputs/examples. `small`: a short run.
"""

import sys
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from matplotlib.figure import Figure

import pcnclaws as pc
from pcnclaws.laws.base import Values
from pcnclaws.laws.elasticity import StVKHencky
from pcnclaws.laws.operations import deviator, norm, where
from pcnclaws.laws.parameters import POISSONS_RATIO, YIELD_STRESS, YOUNGS_MODULUS

PICTURE, STEPS = Path("outputs/examples/04_your_own_law.png"), 100 if "small" in sys.argv[1:] else 300
HARDENING = pc.Parameter("hardening_modulus", "H", "Pa", lower_included=True, logarithmic=True, search=(1e2, 1e8))


class Hardening(pc.Plasticity):
    """|dev tau| <= tau_Y + H a, where the internal variable a adds up how far dev h has flowed."""

    physical_parameters = (YOUNGS_MODULUS, POISSONS_RATIO, YIELD_STRESS, HARDENING)
    internal_variables = (pc.InternalVariable("plastic_strain"),)

    def flow(self, h: Values, p: Any) -> tuple[Values, Mapping[str, Any]]:
        dev, two_mu = deviator(h), p.youngs_modulus / (1.0 + p.poissons_ratio)
        shear = norm(dev)
        excess = two_mu * shear - p.yield_stress - p.hardening_modulus * p.plastic_strain
        amount = where(excess > 0.0, excess, 0.0) / (two_mu + p.hardening_modulus)
        share = amount / where(shear > 0.0, shear, 1.0)
        return [x - share * d for x, d in zip(h, dev, strict=True)], {"plastic_strain": p.plastic_strain + amount}


ELASTIC = {"youngs_modulus": (2e5, 6e5), "poissons_ratio": (0.2, 0.4)}
METAL = pc.Material("metal", StVKHencky, Hardening, ELASTIC | {"yield_stress": (1e3, 5e3), HARDENING.name: (0.0, 1e5)})


def main() -> None:
    body = pc.Body.cube(side=0.3, centre=(0.5, 0.3, 0.5), particles_per_edge=6 if STEPS == 100 else 12)
    soft = pc.Scene(body, pc.analytic_law(METAL), velocity=(0, -3, 0), yield_stress=2e3, hardening_modulus=0.0)
    scenes = [soft.with_(hardening_modulus=modulus) for modulus in (0.0, 1e4, 5e4)]
    figure = Figure(figsize=(9, 3), layout="constrained")
    axes = figure.subplots(1, 3, sharex=True, sharey=True)
    for panel, scene, motion in zip(axes, scenes, pc.simulate_scenes(scenes, STEPS), strict=True):
        x, y, _ = motion.position[-1].T
        panel.scatter(x, y, s=4)
        panel.set(title=f"H = {scene.parameters[HARDENING.name]:g} Pa", xlabel="x [m]", ylabel="y [m]", aspect="equal")
        print(f"{panel.get_title()}: {float(y.max() - y.min()):.3f} m high at the end")
    PICTURE.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(PICTURE, dpi=150)


if __name__ == "__main__":
    main()
