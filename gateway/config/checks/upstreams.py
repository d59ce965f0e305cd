"""Cross-checks of the servers that the gateway itself connects to."""

from collections.abc import Iterator

from gateway.config.plan.reach import listeners_for, listening
from gateway.config.problem import Path, Problem, error
from gateway.config.schema.config import Config
from gateway.config.schema.upstream import Upstream
from gateway.config.values.address import Address
from gateway.config.values.unitset import show_units


def check_upstreams(config: Config, failed: frozenset[str]) -> Iterator[Problem]:
    """Find servers with an address that is of no use, or this gateway's, and upstreams without units."""
    for upstream in config.upstream:
        if isinstance(upstream.to, Address):
            yield from _check_server((*upstream.path, "to"), upstream.to, config)
        if upstream.units is None and "listen" not in failed and not listeners_for(upstream, config):
            remedy = f'name its units, or give it its own [[listen]] with upstream = "{upstream.label}"'
            yield error(upstream.path, "units is missing", remedy)
        yield from _check_units(upstream)
    for line in config.line:
        if isinstance(line.port, Address):
            yield from _check_server((*line.path, "port"), line.port, config)


def _check_server(path: Path, address: Address, config: Config) -> Iterator[Problem]:
    """Find addresses of this gateway itself. Only the addresses in the file can be compared."""
    if address.is_wildcard:
        yield error(path, f"{address.host} is not the address of a server", "name the server: its host name or address")
    if not address.port:
        yield error(path, "port 0 is not the port of a server")
    for bind, source in listening(config):
        if bind.is_reached_by(address):
            yield error(path, f"leads back to this gateway ({source})", "name another server")


def _check_units(upstream: Upstream) -> Iterator[Problem]:
    if upstream.units == ():
        yield error((*upstream.path, "units"), "is empty", "write units = [{ as = 37, unit = 37 }]")
    for row in upstream.units or ():
        if len(row.known_as) != len(row.units):
            yield error(
                (*row.path, "as"),
                f"names {len(row.known_as)} units for clients, but there are {len(row.units)} behind the server",
                f'as many as in unit = "{show_units(row.units)}" are needed',
            )
