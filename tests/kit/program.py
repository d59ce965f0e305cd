"""A program that a gateway in virtual time is a part of: its units, as it asks them."""

from gateway.library.unit_client import UnitClient
from gateway.operator.operator import Operator
from kit.asking import NO_FILE
from kit.gateway_bench import GatewayBench


def unit_of(bench: GatewayBench, unit: int | str) -> UnitClient:
    """A unit of a gateway that does not stop."""
    operator = Operator(bench.running, NO_FILE)
    return UnitClient(lambda: operator, unit)
