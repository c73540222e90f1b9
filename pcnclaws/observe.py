"""Markers, or unlabelled points, of a simulated motion as cameras see them.

python -m pcnclaws.observe file=x.h5 markers=0.1 noise=1e-3
python -m pcnclaws.observe file=x.h5 kind=points points=500 'camera=[1,1,1]' noise=2e-3 output=points.npz
"""

from pcnclaws.commands import launcher
from pcnclaws.commands.tasks import observe


def main() -> None:
    """The command."""
    launcher.main(observe, "observe")


if __name__ == "__main__":
    main()
