"""The config of nats-server for all sites: an account for each of them, and what passes from one to another.

In an account of its own a site hears only what the imports name, and the server's answers to it, whose subject it may
choose, reach nobody else.
"""

import json
from collections.abc import Iterable, Iterator, Mapping
from typing import Final

from gateway.config.schema.hub import Hub
from gateway.fleet.hub.known import Login
from gateway.fleet.hub.rights import (
    BUCKETS,
    INFO,
    MAKE,
    READ,
    entry,
    exports,
    from_asker,
    from_owner,
    hears,
    renamed,
)

#: The account of the buckets: no site can have this name.
STORE: Final = "mbgw.buckets"
LEAF_PORT: Final = 7422
#: At least so many subscriptions has a connection; a gateway has one for each unit, each site that it asks, and a few.
_SUBSCRIPTIONS: Final = 2000
_OTHER_SUBSCRIPTIONS: Final = 500
#: Connections of all gateways of a site that is not control. One with all of the hub's would keep the others out.
_CONNECTIONS: Final = 20

_HEAD: Final = """\
# The NATS server of a fleet, written by `modbus-gateway fleet hub`: change {file}, not this file.
# It has only public keys{but}.
# Settings of your own: a file with `include "hub.conf"`, and behind that line what you set otherwise.

server_name: hub
listen: {listen}
{tls}http: "127.0.0.1:8222"    # for programs on this machine that watch it: curl http://127.0.0.1:8222/connz
jetstream {{ store_dir: {store}, domain: hub, max_memory_store: 64MB, max_file_store: 1GB }}
max_payload: 64KB    # the longest Modbus message has 253 bytes, a status some KB
max_connections: 12000
max_subscriptions: {subscriptions}
write_deadline: "5s"
max_pending: 8MB     # of each connection that does not read; by 64MB one site with all of its own could take 1.1 GB
{leafnodes}"""


def hub_config(hub: Hub, logins: Mapping[str, Login], file: str) -> str:
    """Write the config of the hub. `logins` has one for each site; `file` is the list of sites."""
    return "".join((_head(hub, file), "\naccounts {\n", *_accounts(hub, logins), "}\n"))


def sites_of(hub: Hub) -> tuple[str, ...]:
    """List all sites."""
    return (*hub.control, *hub.sites)


def buckets_of(hub: Hub, site: str) -> list[str]:
    """List the buckets at the hub that a site uses. Leases of a site with a leaf node live there."""
    has_leases = any(leases_of(hub, site)) and site not in hub.leaf_nodes
    return list(BUCKETS) if has_leases or site in hub.control else ["status"]


def leases_of(hub: Hub, site: str) -> list[str]:
    """List the leases of a site."""
    return [lease for lease in hub.leases if lease.startswith(f"{site}.")]


def quoted(*texts: str) -> str:
    """Write text, or several texts of a list, as the config has them."""
    return ", ".join(json.dumps(text, ensure_ascii=False) for text in texts)


def tls(hub: Hub) -> str:
    """Write the section with the hub's certificate; empty without one."""
    if hub.certificate is None or hub.key is None:
        return ""
    return f"tls {{ cert_file: {quoted(hub.certificate)}, key_file: {quoted(hub.key)} }}"


def _head(hub: Hub, file: str) -> str:
    host, port = ("0.0.0.0" if tls(hub) else "127.0.0.1"), 4222  # noqa: S104 - a server of others
    if hub.listen is not None:
        host, port = hub.listen.host, hub.listen.port
    elif hub.address is not None:
        port = hub.address.port
    count = len(sites_of(hub))
    return _HEAD.format(
        file=file,
        but=", and the passwords of leaf nodes" if hub.leaf_nodes else "",
        listen=quoted(_joined(host, port)),
        tls=f"{tls(hub)}\n" if tls(hub) else "",
        store=quoted(hub.store),
        subscriptions=max(_SUBSCRIPTIONS, count + _OTHER_SUBSCRIPTIONS),
        leafnodes=_leaf_listener(hub, host),
    )


def _leaf_listener(hub: Hub, host: str) -> str:
    if not hub.leaf_nodes or hub.address is None:
        return ""
    own, reached = _joined(host, LEAF_PORT), _joined(hub.address.host, LEAF_PORT)
    return f"leafnodes {{ listen: {quoted(own)}, advertise: {quoted(reached)}{', ' if tls(hub) else ''}{tls(hub)} }}\n"


def _joined(host: str, port: int) -> str:
    return f"[{host}]:{port}" if ":" in host else f"{host}:{port}"


def _accounts(hub: Hub, logins: Mapping[str, Login]) -> Iterator[str]:
    yield _store(hub)
    askers, asked = _ways(hub)
    for site in sites_of(hub):
        yield f"\n  {quoted(site)}: {{\n"
        yield "".join(f"    {line}\n" for line in _account(hub, site, logins[site], askers[site], asked[site]))
        yield "  }\n"


def _ways(hub: Hub) -> tuple[dict[str, list[str]], dict[str, list[str]]]:
    """Find for each site who may ask it, and whom it may ask."""
    sites = sites_of(hub)
    askers: dict[str, list[str]] = {site: [] for site in sites}
    asked: dict[str, list[str]] = {site: [] for site in sites}
    for asker in sites:
        for owner in sites if asker in hub.control else hub.asks.get(asker, ()):
            if owner != asker:
                askers[owner].append(asker)
                asked[asker].append(owner)
    return askers, asked


def _store(hub: Hub) -> str:
    """Write the account of the buckets, which has no user. Only the sites that are control may make them."""
    makers = f"[{quoted(*hub.control)}]"
    lines = [f"{{ service: {quoted(entry('status', '*'))} }}", f"{{ service: {quoted(entry('lease', '>'))} }}"]
    for name in BUCKETS.values():
        lines += (f"{{ service: {quoted(f'{prefix}{name}')} }}" for prefix in (INFO, READ))
        lines.append(f"{{ service: {quoted(f'{MAKE}{name}')}, accounts: {makers} }}")
    exported = "".join(f"      {line}\n" for line in lines)
    return f'  "{STORE}": {{\n    jetstream: enabled\n    exports: [\n{exported}    ]\n  }}\n'


def _account(hub: Hub, site: str, login: Login, askers: Iterable[str], asked: Iterable[str]) -> Iterator[str]:
    """Write the lines of the account of a site."""
    is_leaf = site in hub.leaf_nodes
    buckets = buckets_of(hub, site)
    names = dict(renamed(buckets, may_make=site in hub.control))
    own = [entry("status", site)]
    own += [entry("lease", lease) for lease in leases_of(hub, site) if "lease" in buckets]
    if is_leaf:
        yield f"# Its gateways connect to its leaf node: nkey: {login.key}"
        yield f"users: [{{ user: {quoted(site)}, password: {quoted(login.password)}, {_LEAF_ONLY} }}]"
    else:
        yield f"users: [{{ nkey: {login.key}, permissions: {{"
        yield f"  publish: [{quoted(*exports(site), *own, *names.values())}]"
        yield f"  subscribe: [{quoted(*hears(site))}]"
        yield "} }]"
        yield f"mappings: {{ {', '.join(f'{quoted(theirs)}: {quoted(name)}' for theirs, name in names.items())} }}"
    if site not in hub.control:
        yield f"limits: {{ max_connections: {_CONNECTIONS}{', max_leafnodes: 4' if is_leaf else ''} }}"
    yield f"exports: [{', '.join(f'{{ stream: {quoted(subject)} }}' for subject in exports(site))}]"
    yield "imports: ["
    for subject in own:
        yield f"  {_service(subject, f'status.put.{site}' if is_leaf else '')}"
    for theirs, name in names.items():
        yield f"  {_service(theirs, name)}"
    for asker in askers:
        yield f"  {_stream(asker, from_asker(site, asker))}"
    for owner in asked:
        yield from (f"  {_stream(owner, subject)}" for subject in from_owner(site, owner))
    yield "]"


_LEAF_ONLY: Final = 'allowed_connection_types: ["LEAFNODE"]'


def _service(subject: str, name: str) -> str:
    renamed_to = f", to: {quoted(name)}" if name else ""
    return f"{{ service: {{ account: {quoted(STORE)}, subject: {quoted(subject)} }}{renamed_to} }}"


def _stream(account: str, subject: str) -> str:
    return f"{{ stream: {{ account: {quoted(account)}, subject: {quoted(subject)} }} }}"
