"""Command-line options of the network on which the commands `unitree` and `drive` exchange messages."""

from dataclasses import dataclass
from typing import TYPE_CHECKING

from quad_env.cli.command_line import check_numbers

if TYPE_CHECKING:
    from live.unitree.dds import Bus

MAX_DOMAIN = 232
"""Largest number of a DDS domain; the ports of larger numbers do not exist."""


@dataclass(frozen=True, kw_only=True)
class NetworkOptions:
    """Options of the network: interface and DDS domain."""

    interface: str = "lo"
    """Network interface, such as eth0; lo reaches only the programs of this machine."""
    domain: int = 1
    """DDS domain, 0 to 232; a real robot has the domain 0, which no simulation should share with it."""

    def connect(self) -> "Bus":
        """Join the domain on the interface; raise UsageError if one of them does not exist."""
        check_numbers(self, {"domain": (0, MAX_DOMAIN)})
        # The module is imported here, because Cyclone DDS is an optional dependency.
        from live.unitree.dds import Bus

        return Bus(self.domain, self.interface)
