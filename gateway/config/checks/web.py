"""Cross-checks of `[web]`: who can reach it must be able to log in, and what it names must be of use."""

from collections.abc import Iterator

from gateway.config.checks.access import overlap
from gateway.config.checks.listeners import taken
from gateway.config.plan.reach import listening
from gateway.config.problem import Problem, error, warning
from gateway.config.schema.add_ons import Web
from gateway.config.schema.config import Config
from gateway.routing.access import LOOPBACK


def check_web(config: Config, failed: frozenset[str]) -> Iterator[Problem]:
    """Find keys of `[web]` that do not fit together, or have no effect. `failed` as in `check`."""
    if config.web is not None:
        if "listen" not in failed:
            yield from _check_bind(config.web, config)
        yield from _check_reach(config.web)
        yield from _check_encryption(config.web)
        yield from _check_writing(config.web)
        yield from _check_proxy(config.web)


def _check_bind(web: Web, config: Config) -> Iterator[Problem]:
    """Find the listeners that have the address of the page."""
    where = "in {}" if config.listen else "by {}"
    for bind, source in listening(config):
        takes_ipv4 = bind.takes_ipv4_of(web.bind) and not any(bind.takes_ipv4_of(one.bind) for one in config.listen)
        if takes_ipv4 or bind.collides_with(web.bind):
            yield taken((*web.path, "bind"), web.bind, bind, where.format(source))


def _check_reach(web: Web) -> Iterator[Problem]:
    if not web.bind.is_loopback and not (web.users or web.token or web.proxy):
        what = "other machines can reach it, so it needs users, or a token for programs only"
        remedy = f'add users = "/etc/modbus-gateway/users", or bind = "{web.bind.scheme}://127.0.0.1:{web.bind.port}"'
        yield error((*web.path, "bind"), what, remedy)


def _check_encryption(web: Web) -> Iterator[Problem]:
    is_encrypted = web.bind.scheme == "https"
    for key in ("certificate", "key"):
        if is_encrypted and not web.has(key):
            yield error((*web.path, "bind"), f"https:// needs {key}", f'add {key} = "/etc/modbus-gateway/tls/web.pem"')
        elif not is_encrypted and web.has(key):
            yield error((*web.path, key), "is used only with https://", "write https:// in bind, or leave it out")
    if web.users and not (is_encrypted or web.bind.is_loopback or web.proxy):
        what = "passwords and tokens come in plain text, for everybody on the way to read"
        yield warning((*web.path, "bind"), what, "use https:// with certificate and key, or a proxy that does")


def _check_writing(web: Web) -> Iterator[Problem]:
    if web.write and not web.users:
        what = "nobody can log in, so nobody can write"
        yield error((*web.path, "write"), what, 'add users = "/etc/modbus-gateway/users"')


def _check_proxy(web: Web) -> Iterator[Problem]:
    if web.proxy and any(overlap(network, own) for network in web.proxy for own in LOOPBACK):
        what = "every account and program on this machine can name itself any user, operators too"
        remedy = "give the proxy an address of its own, as in a container, or let nobody else use this machine"
        yield warning((*web.path, "proxy"), what, remedy)
