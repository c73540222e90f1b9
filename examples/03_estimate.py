"""Two unknown parameters from motion, by Gauss-Newton with exact sensitivities: python examples/03_estimate.py

`python -m pcnclaws.estimate` does the same with intervals, markers, gaps and unknown start velocities. Leaves a picture
of the search in outputs/examples. `small` behind it: a short run.
"""

import sys
from pathlib import Path

import torch
from matplotlib.figure import Figure

import pcnclaws as pc

SMALL = "small" in sys.argv[1:]
PICTURE = Path("outputs/examples/03_estimate.png")
STEPS, EVERY, ITERATIONS = (60, 20, 2) if SMALL else (300, 20, 6)
TRUTH = {"youngs_modulus": 3.7e5, "friction_angle": 31.0}


def main() -> None:
    body = pc.Body.cube(side=0.3, centre=(0.5, 0.28, 0.5), particles_per_edge=6 if SMALL else 8)
    truth = pc.Scene(body, pc.analytic_law("sand"), velocity=(1.0, -3.0, 0.0), spin=(0.0, 2.0, 4.0)).with_(**TRUTH)
    seen = truth.simulate(STEPS, EVERY, torch.float64).position
    seen = seen + 1e-4 * torch.randn(seen.shape, dtype=seen.dtype, generator=torch.Generator().manual_seed(0))

    guess, path = {"youngs_modulus": 2.5e5, "friction_angle": 24.0}, []
    for iteration in range(ITERATIONS):
        scene = truth.with_(**guess)
        residual = (scene.rollout(STEPS, EVERY, dtype=torch.float64) - seen).flatten()
        slopes = [scene.sensitivity(name, STEPS, EVERY, dtype=torch.float64).flatten() for name in TRUTH]
        path.append(dict(guess))
        print(f"iteration {iteration}: {guess}, RMS {float(residual.square().mean().sqrt()):.3g} m")
        # in units of the guess: the two differ by four orders of magnitude
        jacobian = torch.stack([slope * guess[name] for name, slope in zip(TRUTH, slopes, strict=True)], dim=1)
        step = torch.linalg.lstsq(jacobian, -residual[:, None]).solution[:, 0]
        for name, change in zip(TRUTH, step.clamp(-0.5, 0.5).tolist(), strict=True):
            guess[name] *= 1.0 + change
    path.append(dict(guess))

    figure = Figure(figsize=(6, 2.5), layout="constrained")
    for axes, (name, true) in zip(figure.subplots(1, 2), TRUTH.items(), strict=True):
        axes.plot([values[name] for values in path], marker="o")
        axes.axhline(true, color="black", linewidth=0.8)
        axes.set(xlabel="iteration", title=name)
    PICTURE.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(PICTURE)
    print("wrote", PICTURE)


if __name__ == "__main__":
    main()
