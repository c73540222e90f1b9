"""A torus of sand falls onto the floor: python examples/01_drop_a_shape.py

Leaves a picture, a trajectory file and a collection for ParaView in outputs/examples. `small` behind it: a short run.
"""

import sys
from pathlib import Path

import pcnclaws as pc

SMALL = "small" in sys.argv[1:]
FOLDER = Path("outputs/examples")


def main() -> None:
    body = pc.Body.shape("torus", side=0.6, centre=(0.5, 0.5, 0.5), particles_per_edge=12 if SMALL else 24)
    law = pc.load_law("sand")  # the neural law that ships; pc.analytic_law("sand") is the ground truth
    print(body, "of", law.material.name, {name: law.ranges[name] for name in law.parameter_names})

    scene = pc.Scene(body, law, friction_angle=33.0, velocity=(0.5, -2.0, 0.0), spin=(0.0, 4.0, 2.0))
    print(f"{scene}, CFL number {scene.cfl:.2f}, largest stable time step {scene.stable_time_step:g} s")

    motion = scene.simulate(steps=60 if SMALL else 600, every=20)
    print(f"{motion}: fell by {float((motion.position[0] - motion.position[-1])[:, 1].mean()):.3f} m")
    for ending in ("png", "h5", "pvd"):
        print("wrote", motion.save(FOLDER / f"01_drop_a_shape.{ending}"))


if __name__ == "__main__":
    main()
