"""Cross-checks of the servers that the gateway itself connects to."""

from collections.abc import Iterator
from typing import Final

from gateway.config.plan.names import rows_of
from gateway.config.plan.reach import listeners_for, listening
from gateway.config.problem import Path, Problem, error, warning
from gateway.config.schema.config import Config
from gateway.config.schema.upstream import Upstream
from gateway.config.values.address import Address
from gateway.config.values.duration import show_duration
from gateway.config.values.site import Site

#: Keys that are for connections to servers.
_ONLY_TCP: Final = ("gap", "after_connect", "idle", "coalesce", "transaction_id")


def check_upstreams(config: Config, failed: frozenset[str]) -> Iterator[Problem]:
    """Find servers with an address that is of no use, or this gateway's, and upstreams without units."""
    for upstream in config.upstream:
        for index, to in enumerate(upstream.to):
            path = (*upstream.path, "to", index) if len(upstream.to) > 1 else (*upstream.path, "to")
            if isinstance(to, Address):
                yield from _check_server(path, to, config)
        if upstream.units is None and "listen" not in failed and not listeners_for(upstream, config):
            remedy = f'name its units, or give it its own [[listen]] with upstream = "{upstream.label}"'
            yield error(upstream.path, "units is missing", remedy)
        if upstream.units == ():
            yield error((*upstream.path, "units"), "is empty", "write units = [{ as = 37, unit = 37 }]")
        yield from _check_keys(upstream)
    yield from _check_shared(config)
    for line in config.line:
        if isinstance(line.port, Address):
            yield from _check_server((*line.path, "port"), line.port, config)


def _check_shared(config: Config) -> Iterator[Problem]:
    """Find a server that is to get one request at a time, and has another upstream, which does not wait for that."""
    first: dict[Address, Upstream] = {}
    for upstream in config.upstream:
        for to in upstream.to:
            other = first.setdefault(to, upstream) if isinstance(to, Address) else upstream
            if other is not upstream and any(each.in_flight == 1 or each.gap for each in (upstream, other)):
                what = f'{to} is that of upstream "{other.label}" too: one does not wait for the other'
                remedy = f'move its units to "{other.label}", so that the server gets one request at a time'
                yield warning((*upstream.path, "to"), what, remedy)


def _check_server(path: Path, address: Address, config: Config) -> Iterator[Problem]:
    """Find addresses of this gateway itself. Only the addresses in the file can be compared."""
    if address.is_wildcard:
        yield error(path, f"{address.host} is not the address of a server", "name the server: its host name or address")
    if not address.port:
        yield error(path, "port 0 is not the port of a server")
    for bind, source in listening(config):
        if bind.is_reached_by(address):
            yield error(path, f"leads back to this gateway ({source})", "name another server")


def _check_keys(upstream: Upstream) -> Iterator[Problem]:
    """Find keys that do not fit together, or do not fit the gateway of another site."""
    if upstream.has("in_flight") and upstream.in_flight > 1:
        for key, means in (("gap", upstream.gap > 0), ("transaction_id", upstream.transaction_id == "zero")):
            if means:
                path = (*upstream.path, "in_flight")
                yield error(path, f"{key} lets only one request at a time", "leave it out, or write in_flight = 1")
    if isinstance(upstream.to[0], Site):
        for key in filter(upstream.has, _ONLY_TCP):
            yield error((*upstream.path, key), "is for connections, and a site has none", "take it out")
        for table in (upstream, *rows_of(upstream)):
            if table.has("wake"):
                yield error((*table.path, "wake"), "is for the gateway that asks the device itself", "set it there")
    elif upstream.gap >= upstream.max_wait:
        what = f"is longer than max_wait ({show_duration(upstream.max_wait)}): a request that comes within it gets 06"
        yield warning((*upstream.path, "gap"), what, "make max_wait longer")
