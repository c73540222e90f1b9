"""The transfers between particles and grid that can be chosen, by name."""

from types import MappingProxyType

from pcnclaws.errors import unknown_name

APIC = "apic"
# Order of the affine XPIC of each, see mpm/transfer.py. What one transfer to the grid and back loses of a motion to its
# power is lost in a step.
TRANSFERS = MappingProxyType({APIC: 1, "axpic2": 2, "axpic3": 3, "axpic4": 4})


def require_transfer(option: str, name: object) -> None:
    """Refuses what is no name of a transfer with a UserError."""
    if not isinstance(name, str) or name not in TRANSFERS:
        raise unknown_name(option, str(name), TRANSFERS)
