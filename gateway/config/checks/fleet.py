"""Cross-checks of `[fleet]`: what it needs."""

from collections.abc import Iterator
from typing import Final

from gateway.config.problem import Problem, error, warning
from gateway.config.schema.fleet import Fleet
from gateway.config.schema.root import Config
from gateway.config.values.fleet import SITE_RULE, is_site

_TLS_KEYS: Final = ("ca", "certificate", "key")


def check_fleet(config: Config, failed: frozenset[str]) -> Iterator[Problem]:
    """Its own keys fit together, and a lease has servers to ask. `failed` as in `check`."""
    fleet = config.fleet
    if fleet is None:
        for line in config.line if "fleet" not in failed else ():
            if line.lease is not None:
                remedy = 'add [fleet] with servers = ["nats://127.0.0.1:4222"]'
                yield error((*line.path, "lease"), "needs [fleet], where NATS keeps the lease", remedy)
        return
    yield from _check_site(config.site, fleet)
    yield from _check_servers(fleet)
    yield from _check_login(fleet)


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
