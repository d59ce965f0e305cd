"""The config of nats-server at a site with a leaf node: the site goes on alone while the way to the hub is down."""

from typing import Final

from gateway.config.schema.hub import Hub
from gateway.fleet.hub.config import LEAF_PORT, leases_of, quoted, tls
from gateway.fleet.hub.known import Login
from gateway.fleet.hub.rights import entry, exports, hears, renamed

_LEAF: Final = """\
# The NATS server of the site {site}, a leaf node of the hub. `modbus-gateway fleet hub` has written it.
# Settings of your own: a file with `include "{site}.leaf.conf"`, and behind that line what you set otherwise.

server_name: {name}
listen: "127.0.0.1:4222"    # where the gateways of this site find it
http: "127.0.0.1:8222"
leafnodes {{ remotes: [{{ url: {url}{ca} }}] }}
jetstream {{ store_dir: {store}, domain: {name}, max_memory_store: 64MB, max_file_store: 1GB }}
max_payload: 64KB
write_deadline: "5s"

# The leases of the site live here. Status lives at the hub: what the gateways ask about it goes there.
mappings {{
  {status}: {put}
{mappings}}}
authorization {{
  users: [{{ nkey: {key}, permissions: {{
    publish: [{publish}]
    subscribe: [{subscribe}]
  }} }}]
}}
"""


def leaf_config(hub: Hub, site: str, login: Login) -> str:
    """Write the config of the NATS server of a site; `hub` has the address of the hub."""
    assert hub.address is not None  # noqa: S101 - a file without it has a problem
    host = f"[{hub.address.host}]" if ":" in hub.address.host else hub.address.host
    scheme = "tls" if tls(hub) else "nats-leaf"
    names = dict(renamed(["status"]))
    lease = [entry("lease", each) for each in leases_of(hub, site)]
    lease += [subject for subject, _ in renamed(["lease"], may_make=True)] if lease else []
    return _LEAF.format(
        site=site,
        name=quoted(site),
        url=quoted(f"{scheme}://{site}:{login.password}@{host}:{LEAF_PORT}"),
        ca="" if hub.ca is None else f", tls {{ ca_file: {quoted(hub.ca)} }}",
        store=quoted(hub.store),
        status=quoted(entry("status", "*")),
        put=quoted("status.put.$1"),
        mappings="".join(f"  {quoted(theirs)}: {quoted(name)}\n" for theirs, name in names.items()),
        key=login.key,
        publish=quoted(*exports(site), f"status.put.{site}", *names.values(), *lease),
        subscribe=quoted(*hears(site)),
    )
