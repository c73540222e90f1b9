"""A neural law of sand learns from motion, in a plain PyTorch loop: python examples/02_train_sand.py

`python -m pcnclaws.train experiment=sand_multi` does the same with data sets, validation and checkpoints. Leaves a
picture of the errors in outputs/examples. `small` behind it: a short run.
"""

import sys
from pathlib import Path

import torch
from matplotlib.figure import Figure

import pcnclaws as pc

SMALL = "small" in sys.argv[1:]
PICTURE = Path("outputs/examples/02_train_sand.png")
STEPS, EVERY, ITERATIONS = (40, 20, 2) if SMALL else (160, 10, 60)


def main() -> None:
    torch.manual_seed(0)
    truth, law = pc.analytic_law("sand"), pc.neural_law("sand")
    body = pc.Body.cube(side=0.3, centre=(0.5, 0.28, 0.5), particles_per_edge=6 if SMALL else 8)
    thrown = pc.Scene(body, truth, velocity=(1.0, -3.0, 0.0), spin=(0.0, 2.0, 4.0))
    scenes = [thrown.with_(friction_angle=angle) for angle in (20.0, 28.0, 36.0)]
    seen = [scene.simulate(STEPS, EVERY).position for scene in scenes]

    # relative to how much the motions differ
    scale = (seen[0] - seen[-1]).square().mean()
    optimiser = torch.optim.Adam(law.parameters(), lr=3e-3)
    schedule = torch.optim.lr_scheduler.CosineAnnealingLR(optimiser, ITERATIONS)
    errors = []
    for iteration in range(ITERATIONS):
        optimiser.zero_grad()
        for scene, target in zip(scenes, seen, strict=True):
            predicted = scene.with_(law=law).rollout(STEPS, EVERY)
            error = (predicted - target).square().mean() / scale / len(scenes)
            error.backward()
            errors.append(float(error.detach()) * len(scenes))
        optimiser.step()
        schedule.step()
        print(f"iteration {iteration}: relative error {sum(errors[-len(scenes) :]) / len(scenes):.3g}")

    figure = Figure(figsize=(5, 3), layout="constrained")
    axes = figure.subplots()
    for k, scene in enumerate(scenes):
        axes.semilogy(errors[k :: len(scenes)], label=f"friction angle {scene.parameters['friction_angle']:g}°")
    axes.set(xlabel="iteration", ylabel="squared error, relative")
    axes.legend()
    PICTURE.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(PICTURE)
    print("wrote", PICTURE)


if __name__ == "__main__":
    main()
