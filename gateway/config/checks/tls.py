"""Cross-checks of what TLS needs: certificates, keys, authorities, and rows of `[[access]]` with roles."""

from collections.abc import Iterator
from typing import Final

from gateway.config.problem import Problem, error, warning
from gateway.config.schema.access import Access
from gateway.config.schema.config import Config
from gateway.config.schema.listen import Listen
from gateway.config.schema.upstream import Upstream

_FOLDER: Final = "/etc/modbus-gateway/tls"
_HOW: Final = "modbus-gateway certificates makes the files"
_EXAMPLES: Final = {
    "certificate": "server.crt",
    "key": "server.key",
    "clients_ca": "ca.crt",
    "ca": "ca.crt",
    "crl": "ca.crl",
}


def check_tls(config: Config) -> Iterator[Problem]:
    """Find TLS that lacks something it needs, its keys where there is no TLS, and roles that no client can have."""
    for listen in config.listen:
        yield from _check_keys(listen, ("bind", listen.bind.scheme), ("certificate", "key", "clients_ca"), ("crl",))
    for upstream in config.upstream:
        schemes = {to.scheme for to in upstream.to}
        scheme = "tls" if "tls" in schemes else schemes.pop()
        yield from _check_keys(upstream, ("to", scheme), ("certificate", "key", "ca"), ("server_name",))
    for row in config.access:
        yield from _check_role(row, config)
    yield from _check_rights(config)


def _check_keys(
    table: Listen | Upstream, address: tuple[str, str], needed: tuple[str, ...], optional: tuple[str, ...]
) -> Iterator[Problem]:
    key, scheme = address
    if scheme == "tls":
        missing = [each for each in needed if not table.has(each)]
        if missing:
            lines = ", ".join(f'{each} = "{_FOLDER}/{_EXAMPLES[each]}"' for each in missing)
            yield error((*table.path, key), f"tls:// needs {', '.join(missing)}", f"add {lines}; {_HOW}")
        return
    for each in filter(table.has, (*needed, *optional)):
        yield error((*table.path, each), "is used only with tls://", f"write tls:// in {key}, or leave it out")


def _check_role(row: Access, config: Config) -> Iterator[Problem]:
    """Find roles in rows for listeners whose clients show no certificates."""
    if row.role is None:
        return
    secured = {listen.label for listen in config.listen if listen.bind.scheme == "tls"}
    if not secured:
        yield warning((*row.path, "role"), "no listener with tls:// is there, so the row never matches")
    elif row.listen is not None and not secured.intersection(row.listen):
        what = "none of these listeners has tls://, so the row never matches"
        yield warning((*row.path, "role"), what, f"leave listen out, or name {' or '.join(sorted(secured))}")


def _check_rights(config: Config) -> Iterator[Problem]:
    """Find TLS listeners whose clients have no right. Without any rows they may read."""
    for listen in config.listen:
        if listen.bind.scheme != "tls":
            continue
        meant = [row for row in config.access if row.listen is None or listen.label in row.listen]
        if config.access and not any(row.role is not None or row.listen is not None for row in meant):
            what = "no row of [[access]] gives its clients any right: a row without role must name the listener"
            remedy = f'add a row with role = "operator", or with listen = ["{listen.label}"]'
            yield warning((*listen.path, "bind"), what, remedy)
