"""Cross-checks of `[fleet]`: what it needs."""

from collections.abc import Iterator
from typing import Final

from gateway.config.problem import Problem, error, warning
from gateway.config.schema.access import Access
from gateway.config.schema.add_ons import Fleet
from gateway.config.schema.config import Config
from gateway.config.schema.upstream import Upstream
from gateway.config.values.reserved_names import FLEET
from gateway.config.values.site import SITE_RULE, Site, is_site

_ADD: Final = 'add [fleet] with servers = ["nats://127.0.0.1:4222"]'
#: What a request to another site should have, in seconds.
_SHORTEST_TO_SITE: Final = 0.25
_TLS_KEYS: Final = ("ca", "certificate", "key")


def check_fleet(config: Config, failed: frozenset[str]) -> Iterator[Problem]:
    """Find keys of `[fleet]` that do not fit together, and what needs it elsewhere. `failed` as in `check`."""
    fleet = config.fleet
    if fleet is not None:
        yield from _check_site(config.site, fleet)
        yield from _check_servers(fleet)
        yield from _check_login(fleet)
    elif "fleet" not in failed:
        for line in config.line:
            if line.lease is not None:
                yield error((*line.path, "lease"), "needs [fleet], where NATS keeps the lease", _ADD)
    for upstream in config.upstream:
        if isinstance(upstream.to[0], Site):
            yield from _check_upstream(upstream, upstream.to[0], config, failed)
    for row in config.access if not failed & {"listen", "line"} else ():
        yield from _check_access(row)


def _check_upstream(upstream: Upstream, other: Site, config: Config, failed: frozenset[str]) -> Iterator[Problem]:
    """Find why another site cannot be reached. Which sites there are is known to NATS only.

    The upstream of a listener for a site stands there.
    """
    path = (*upstream.path, "site" if upstream.path[0] == "listen" else "to")
    if config.fleet is None and "fleet" not in failed:
        yield error(path, f"{other} needs [fleet]", _ADD)
    if other.name == config.site:
        yield error(path, f"leads back to this gateway: {config.site} is its own site", "name another site")
    if upstream.timeout is not None and upstream.timeout < _SHORTEST_TO_SITE:
        what = "is short for another site: heartbeat, request and response take their way, and 50 ms are kept"
        yield warning((*upstream.path, "timeout"), what, 'write "250 ms" or more')


def _check_access(row: Access) -> Iterator[Problem]:
    """Find sites in rows for others, and clients that are no sites in rows for the fleet."""
    for index, each in enumerate(row.networks or ()):
        path = (*row.path, "from", index)
        if isinstance(each, Site) and row.listen != (FLEET,):
            remedy = f'write it as "10.2.0.0/24" or "10.2.0.7"; a row for a site needs listen = ["{FLEET}"]'
            yield error(path, f'"{each.name}" is not a valid network', remedy)
        elif not isinstance(each, Site) and row.listen == (FLEET,):
            yield error(path, f'clients of "{FLEET}" are sites, and have no network', 'such as from = ["plant-1"]')


def _check_site(site: str, fleet: Fleet) -> Iterator[Problem]:
    if not site:
        what = "needs the name of this gateway's site, by which others reach it"
        yield error((*fleet.path, "servers"), what, 'add site = "plant-2" at the top of the file')
    elif not is_site(site):
        yield error(("site",), f'"{site}" cannot be the name of a site in [fleet]', SITE_RULE)


def _check_servers(fleet: Fleet) -> Iterator[Problem]:
    for index, server in enumerate(fleet.servers):
        path = (*fleet.path, "servers", index)
        if server.is_wildcard:
            yield error(path, f"{server.host} is not the address of a server", "write its host name or address")
        if not server.port:
            yield error(path, "port 0 is not the port of a server")
        if server.scheme == "nats" and not server.is_loopback and (fleet.user or fleet.credentials):
            yield warning(path, "the connection is not encrypted", f"write tls://{server.host}:{server.port}")
    encrypted = any(server.scheme == "tls" for server in fleet.servers)
    for key in () if encrypted else filter(fleet.has, _TLS_KEYS):
        yield error((*fleet.path, key), "is used only with tls://", "write tls:// in servers")


def _check_login(fleet: Fleet) -> Iterator[Problem]:
    for one, other in (("certificate", "key"), ("key", "certificate"), ("password", "user"), ("user", "password")):
        if fleet.has(one) and not fleet.has(other):
            yield error((*fleet.path, one), f"has no effect without {other}", f"add {other}")
    if fleet.credentials is not None and fleet.user is not None:
        yield error((*fleet.path, "user"), "cannot be used together with credentials", "leave one of the two out")
