"""Cross-checks of the servers that the gateway itself connects to."""

from collections.abc import Iterator
from typing import Final

from gateway.config.problem import Path, Problem, error, warning
from gateway.config.schema.root import Config, Upstream
from gateway.config.values.address import Address
from gateway.config.values.fleet import Site
from gateway.config.values.unitset import show_units

#: What a request to another site should have, in seconds.
_SHORTEST_TO_SITE: Final = 0.25


def check_upstreams(config: Config, failed: frozenset[str]) -> Iterator[Problem]:
    """Servers have a usable address and are not this gateway. An upstream has units. `failed` as in `check`."""
    for upstream in config.upstream:
        path = (*upstream.path, "to")
        if isinstance(upstream.to, Site):
            yield from _check_site(path, upstream.to, config)
            if upstream.timeout < _SHORTEST_TO_SITE:
                what = "is short for another site: heartbeat, request and response take their way, and 50 ms are kept"
                yield warning((*upstream.path, "timeout"), what, 'write "250 ms" or more')
        else:
            yield from _check_server(path, upstream.to, config)
        if upstream.units is None and "listen" not in failed and not config.listeners_for(upstream):
            remedy = f'name its units, or give it its own [[listen]] with upstream = "{upstream.label}"'
            yield error(upstream.path, "units is missing", remedy)
        yield from _check_units(upstream)
    for line in config.line:
        if isinstance(line.port, Address):
            yield from _check_server((*line.path, "port"), line.port, config)


def _check_server(path: Path, address: Address, config: Config) -> Iterator[Problem]:
    """A gateway must not be its own upstream. Only the addresses in the file can be compared."""
    if address.is_wildcard:
        yield error(path, f"{address.host} is not the address of a server", "name the server: its host name or address")
    if not address.port:
        yield error(path, "port 0 is not the port of a server")
    for bind, source in config.binds:
        if bind.is_reached_by(address):
            yield error(path, f"leads back to this gateway ({source})", "name another server")


def _check_site(path: Path, other: Site, config: Config) -> Iterator[Problem]:
    """Which sites there are is known to NATS only."""
    if config.fleet is None:
        yield error(path, f"{other} needs [fleet]", 'add [fleet] with servers = ["nats://127.0.0.1:4222"]')
    if other.name == config.site:
        yield error(path, f"leads back to this gateway: {config.site} is its own site", "name another site")


def _check_units(upstream: Upstream) -> Iterator[Problem]:
    if upstream.units == ():
        yield error((*upstream.path, "units"), "is empty", "write units = [{ as = 37, unit = 37 }]")
    for row in upstream.rows:
        if len(row.known_as) != len(row.units):
            yield error(
                (*row.path, "as"),
                f"names {len(row.known_as)} units for clients, but there are {len(row.units)} behind the server",
                f'as many as in unit = "{show_units(row.units)}" are needed',
            )
