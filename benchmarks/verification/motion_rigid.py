"""Bodies that fall, turn, slide and collide: what mechanics of points and rigid bodies says of them."""

import math

import numpy as np
import torch

import pcnclaws as pc
from benchmarks.verification.case import Case, Curve, Line, Outcome, Table, many_numbers, one_number, violation
from benchmarks.verification.motion_scenes import NO_GRAVITY, affine_of, array, box

GRAVITY = 9.8
ELASTIC = {"youngs_modulus": 3e5, "poissons_ratio": 0.2}


def free_fall() -> Outcome:
    """Heights of the centre of mass of a thrown ball, which is stepped, beside the discrete parabola."""
    body = pc.Body.sphere(side=0.4, centre=(0.5, 0.5, 0.5), particles_per_edge=8)
    nothing = pc.Load(low=(0, 0, 0), high=(1, 1, 1), acceleration=(0, 0, 0))  # keeps the fast path away
    settings = pc.Settings(domain=None)
    scene = pc.Scene(body, pc.analytic_law("elasticity"), velocity=(1, 2, 0), settings=settings, loads=[nothing])
    motion = scene.simulate(400, 10, dtype=torch.float64)
    n = np.round(array(motion.time) / scene.time_step)
    dt = scene.time_step
    height = array(motion.position).mean(1)[:, 1]
    expected = height[0] + n * dt * 2.0 - GRAVITY * dt**2 * n * (n + 1.0) / 2.0
    curve = Curve("time [s]", "height [m]", [Line("centre of mass", array(motion.time), height, expected)])
    return many_numbers(height, expected, "m", curve=curve)


def free_rotation() -> Outcome:
    """Angular momentum of a block after five turns, relative to the start; affine velocities are part of it."""
    sides, omega, spacing = (0.4, 0.2, 0.1), 10.0, 0.05
    body = box((0.3, 0.4, 0.45), sides, (16, 8, 4))
    law = pc.analytic_law("elasticity")
    settings = pc.Settings(domain=None, gravity=NO_GRAVITY, grid_spacing=spacing, time_step=4e-4)
    scene = pc.Scene(body, law, spin=(0, 0, omega), settings=settings, youngs_modulus=2e6, poissons_ratio=0.2)
    turns = 5
    every = round(turns * 2.0 * math.pi / omega / scene.time_step / 40)
    motion = scene.simulate(40 * every, every, dtype=torch.float64, deformation=True)
    affine = affine_of(motion)
    arm = array(motion.position) - array(motion.position).mean(1, keepdims=True)
    velocity = array(motion.velocity)
    skew = 0.25 * spacing**2 * (affine[..., 1, 0] - affine[..., 0, 1])
    momentum = (arm[..., 0] * velocity[..., 1] - arm[..., 1] * velocity[..., 0] + skew).sum(1)
    left = momentum / momentum[0]
    line = Line("angular momentum", array(motion.time), left, np.ones_like(left))
    return one_number(float(left[-1]), 1.0, curve=Curve("time [s]", "angular momentum / start [-]", [line]))


def _tilted(degrees: float) -> tuple[float, float, float]:
    """Gravity on a floor that is tilted about z by this angle [m/s^2]."""
    slope = math.radians(degrees)
    return (GRAVITY * math.sin(slope), -GRAVITY * math.cos(slope), 0.0)


def sliding_block(friction: float, degrees: float = 30.0) -> Line:
    """Speeds of a block down a slope: ours, and those of the accelerated mass point.

    The block is let go with its lowest particles at rest on the wall; the first 0.1 s, while it settles, do not count.
    """
    spacing = 0.05
    body = box((0.2, 0.05, 0.3), (0.2, 0.2, 0.2), (8, 8, 8))
    settings = pc.Settings(
        domain=((0, 0, 0), (1.5, 0.5, 0.8)),
        wall_distance=spacing,
        grid_spacing=spacing,
        gravity=_tilted(degrees),
        friction=friction,
        time_step=4e-4,
    )
    scene = pc.Scene(body, pc.analytic_law("elasticity"), settings=settings, youngs_modulus=1e6, poissons_ratio=0.2)
    motion = scene.simulate(1500, 10, dtype=torch.float64)
    time, speed = array(motion.time), array(motion.velocity).mean(1)[:, 0]
    settled = time >= 0.1
    slope = math.radians(degrees)
    acceleration = max(0.0, GRAVITY * (math.sin(slope) - friction * math.cos(slope)))
    first = speed[settled][0]
    return Line(f"mu {friction:g}", time[settled], speed[settled], first + acceleration * (time[settled] - 0.1))


def incline() -> Outcome:
    """Accelerations at four coefficients of friction; the curve of all."""
    lines = [sliding_block(friction) for friction in (0.0, 0.2, 0.4)]
    slopes = [[np.polyfit(line.x, speeds, 1)[0] for speeds in (line.ours, line.theirs)] for line in lines]
    rows = [[line.label, f"{ours:.4f}", f"{theirs:.4f}"] for line, (ours, theirs) in zip(lines, slopes, strict=True)]
    table = Table(["", "ours [m/s²]", "g (sin - mu cos) [m/s²]"], rows)
    worst = max((one_number(ours, theirs, "m/s²") for ours, theirs in slopes), key=lambda outcome: outcome.difference)
    curve = Curve("time [s]", "speed [m/s]", lines)
    return Outcome(**{**vars(worst), "curve": curve, "table": table})


def sticking() -> Outcome:
    """How far a block slides in half a second with mu above tan(slope), relative to what it would without friction."""
    line = sliding_block(0.7)
    travelled = np.trapezoid(np.asarray(line.ours), np.asarray(line.x))
    return violation(float(travelled) / (0.25 * GRAVITY * 0.5**2))


def impact(cells: int) -> tuple[Line, float, float]:
    """Two balls that meet head on: the speed of the left one, restitution, and the change of momentum.

    cells  along a diameter; two particles along the edge of a cell
    """
    diameter, speed = 0.2, 0.5
    spacing = diameter / cells
    balls = [pc.Body.sphere(side=diameter, centre=(x, 0.5, 0.5), particles_per_edge=2 * cells) for x in (0.36, 0.64)]
    body = pc.Body.points(torch.cat([ball.position for ball in balls]), torch.cat([ball.volume for ball in balls]))
    direction = torch.cat([torch.full((len(ball),), sign) for ball, sign in zip(balls, (1.0, -1.0), strict=True)])
    velocity = torch.zeros(len(body), 3, dtype=torch.float64)
    velocity[:, 0] = speed * direction
    settings = pc.Settings(domain=None, gravity=NO_GRAVITY, grid_spacing=spacing, time_step="auto")
    scene = pc.Scene(
        body,
        pc.analytic_law("neo_hookean"),
        velocity=velocity,
        settings=settings,
        youngs_modulus=1e5,
        poissons_ratio=0.2,
    )
    motion = scene.simulate(
        100 * math.ceil(3e-3 / scene.time_step), math.ceil(3e-3 / scene.time_step), dtype=torch.float64
    )
    speeds = array(motion.velocity)[:, :, 0]
    left = speeds[:, : len(balls[0])].mean(1)
    momentum = speeds.sum(1) / (speed * len(body))
    line = Line(f"{cells} cells", array(motion.time), left / speed, np.where(array(motion.time) < 0.1, 1.0, -1.0))
    return line, float(-left[-1] / speed), float(np.abs(momentum).max())


def restitution() -> Outcome:
    """Of balls of 16 cells; a table of two sizes."""
    found = [impact(cells) for cells in (8, 16)]
    rows = [[line.label, f"{left:.4f}"] for line, left, _ in found]
    curve = Curve("time [s]", "speed of the left ball / start [-]", [found[-1][0]])
    return one_number(found[-1][1], 1.0, curve=curve, table=Table(["", "restitution"], rows))


def momentum() -> Outcome:
    """Largest total momentum relative to that of one ball."""
    return violation(impact(8)[2])


CASES = [
    Case(
        "free_fall",
        "motion",
        "A thrown ball falls as y_0 + n dt v_0 - g dt^2 n (n + 1) / 2, the discrete form of the parabola.",
        "closed form of symplectic Euler",
        1e-12,
        free_fall,
    ),
    Case(
        "free_rotation",
        "motion",
        "A block that turns freely has its angular momentum after five turns.",
        "conservation",
        1e-9,
        free_rotation,
        slow=True,
    ),
    Case(
        "incline_slides",
        "motion",
        "A block on a slope of 30 degrees accelerates by g (sin - mu cos) for mu 0, 0.2 and 0.4.",
        "closed form, Coulomb 1785",
        1e-2,
        incline,
        slow=True,
    ),
    Case(
        "incline_sticks",
        "motion",
        "With mu 0.7, above tan 30 degrees, it stays where it is.",
        "closed form, Coulomb 1785",
        1e-3,
        sticking,
        slow=True,
    ),
    Case(
        "impact_momentum",
        "motion",
        "Two balls that collide keep their momentum.",
        "conservation",
        1e-12,
        momentum,
        slow=True,
    ),
    Case(
        "impact_restitution",
        "motion",
        "Two elastic balls of 16 cells that meet at 1 m/s part with the speed they came with.",
        "Hertz 1882: a slow elastic impact keeps its energy",
        5e-2,
        restitution,
        slow=True,
    ),
]
