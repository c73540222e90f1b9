"""The derivative of a motion in three ways, which agree: python examples/07_gradients.py

Reverse mode: one number with respect to many. Forward mode: every position with respect to one number. Finite
differences: a check of both. Leaves a picture in outputs/examples. `small` behind it: a short run.
"""

import sys
from pathlib import Path

import torch
from matplotlib.figure import Figure

import pcnclaws as pc

SMALL = "small" in sys.argv[1:]
PICTURE = Path("outputs/examples/07_gradients.png")
STEPS = 60 if SMALL else 300


def main() -> None:
    body = pc.Body.cube(side=0.3, centre=(0.5, 0.28, 0.5), particles_per_edge=6 if SMALL else 10)
    scene = pc.Scene(body, pc.load_law("sand"), velocity=(1.0, -3.0, 0.0))

    # reverse mode: how high the body stands, with respect to angle, start velocity and the modulus of each particle
    angle = torch.tensor(30.0, dtype=torch.float64, requires_grad=True)
    velocity = torch.tensor((1.0, -3.0, 0.0), dtype=torch.float64, requires_grad=True)
    modulus = torch.full((len(body),), 4e5, dtype=torch.float64, requires_grad=True)
    end = scene.rollout(STEPS, STEPS, friction_angle=angle, velocity=velocity, youngs_modulus=modulus)[-1]
    by_angle, by_velocity, by_modulus = torch.autograd.grad(end[:, 1].mean(), (angle, velocity, modulus))
    print(f"d(height)/d(friction angle) {float(by_angle):.6e} m/deg, d(height)/d(velocity) {by_velocity.tolist()} s")

    # forward mode: where each particle goes with the angle
    scene = scene.with_(friction_angle=30.0, youngs_modulus=4e5)
    slope = scene.sensitivity("friction_angle", STEPS, STEPS, dtype=torch.float64)[-1]
    print(f"the same in forward mode    {float(slope[:, 1].mean()):.6e} m/deg")

    low, high = (scene.rollout(STEPS, STEPS, friction_angle=30.0 + h, dtype=torch.float64)[-1] for h in (-1e-4, 1e-4))
    print(f"by finite differences       {float((high - low)[:, 1].mean()) / 2e-4:.6e} m/deg")

    figure = Figure(figsize=(9, 3), layout="constrained")
    x, y, _ = end.detach().unbind(1)
    colours = (("m/deg, angle", slope.norm(dim=1)), ("m/Pa, modulus of the particle", by_modulus))
    for axes, (unit, colour) in zip(figure.subplots(1, 2), colours, strict=True):
        figure.colorbar(axes.scatter(x, y, c=colour, s=8), ax=axes, label=unit)
        axes.set(xlabel="x [m]", ylabel="y [m]")
    PICTURE.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(PICTURE)
    print("wrote", PICTURE)


if __name__ == "__main__":
    main()
