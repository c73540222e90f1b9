"""Sand falls onto a turning roller, slides down a chute and is pushed by a piston: python examples/06_obstacles.py

Prints the impulses of the obstacles. Leaves a picture and a trajectory file in outputs/examples. `small` behind it: a
short run.
"""

import sys
from pathlib import Path

import pcnclaws as pc

SMALL = "small" in sys.argv[1:]
FOLDER = Path("outputs/examples")
STEPS, EVERY = (60, 30) if SMALL else (1600, 40)


def main() -> None:
    body = pc.Body.cube(side=0.3, centre=(0.35, 0.75, 0.5), particles_per_edge=6 if SMALL else 14)
    chute = pc.Collider.plane(point=(0.35, 0.3, 0.5), normal=(0.5, 1.0, 0.0), friction=0.2)
    roller = pc.Collider.cylinder((0.35, 0.5, 0.1), (0.35, 0.5, 0.9), 0.08, friction=0.5, spin=(0.0, 0.0, -6.0))
    piston = pc.Collider.box((0.82, 0.1, 0.2), (0.9, 0.4, 0.8), velocity=(-0.4, 0.0, 0.0), start=0.3)
    scene = pc.Scene(
        body, pc.load_law("sand"), friction_angle=28.0, velocity=(0, -1, 0), colliders=[chute, roller, piston]
    )

    motion = scene.simulate(STEPS, EVERY)
    for name, impulse in zip(("chute", "roller", "piston"), motion.impulses[-1].tolist(), strict=True):
        print(f"{name} gave {', '.join(f'{x:.2f}' for x in impulse)} N s")
    for ending in ("png", "h5"):
        print("wrote", motion.save(FOLDER / f"06_obstacles.{ending}"))


if __name__ == "__main__":
    main()
