"""Cases that cannot be had, with the reason."""

from benchmarks.verification.case import absent

CASES = [
    absent(
        "mohr_coulomb_return",
        "The return of Mohr-Coulomb in Hencky strain agrees with Kratos' unit test.",
        "There is no Mohr-Coulomb law; the cone of sand is the outer fit of its pyramid, and does not dilate.",
    ),
    absent(
        "salencon_hole",
        "A pressed cylindrical hole in Mohr-Coulomb ground has Salencon's plastic radius, 1.7350 radii.",
        "It needs Mohr-Coulomb with cohesion, and a pressure far away that follows the ground: walls are rigid.",
    ),
    absent(
        "taylor_bar",
        "A copper bar that hits a wall at 227 m/s keeps the published length.",
        "Of the published lengths none could be looked up in its source; a recalled number would prove nothing.",
    ),
    absent(
        "incompressible_beam",
        "A beam of a Poisson's ratio of 0.499 sags as measured.",
        "Cells lock near 0.5: with 0.45 the thick beam is already stiffer than the right one (`thick_cantilever`), and "
        "the time step goes to 0 with 1 - 2 nu.",
    ),
    absent(
        "couette_bingham",
        "A Newtonian or Bingham fluid between plates has its profile of velocity.",
        "There is no law of a fluid among the materials, and a sheared elastic body with viscosity stores its shear.",
    ),
    absent(
        "measured_cantilever",
        "A beam of silicone sags and swings as it was filmed.",
        "Its Poisson's ratio is near 0.5, where cells lock; its geometry with nu 0 is `thick_cantilever`.",
    ),
    absent(
        "ritter_dam_break",
        "The front of a dam break runs at 2 sqrt(g h).",
        "There is no law of a fluid among the materials; one of one's own would verify that law.",
    ),
]
