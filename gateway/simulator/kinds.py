"""The kinds of devices by the names of their profiles."""

from collections.abc import Mapping
from typing import Final

from gateway.simulator.generic import Generic
from gateway.simulator.mint import Mint
from gateway.simulator.v80 import V80
from gateway.simulator.weigher import Weigher

Kind = type[Mint] | type[V80] | type[Weigher] | type[Generic]

KINDS: Final[Mapping[str, Kind]] = {"mint": Mint, "v80": V80, "weigher": Weigher, "generic": Generic}
