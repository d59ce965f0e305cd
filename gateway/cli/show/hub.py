"""What `fleet hub` says: what it has written, and what is to be done with it."""

from collections.abc import Iterator, Sequence
from typing import Final

from gateway.config.schema.hub import Hub
from gateway.fleet.hub.config import sites_of
from gateway.fleet.hub.folder import CONFIG, CREDENTIALS, LEAF_CONFIG, Written

#: More names than this are only counted.
_MOST_NAMES: Final = 5

_AT_HUB: Final = """
At the machine of the hub, with nats-server 2.9.15 or newer, as any site can end an older one:
  sudo install -o nats -g nats -m 600 {config} /etc/nats-server.conf
  sudo nats-server -t -c /etc/nats-server.conf
  {load}"""
_RESTART: Final = "sudo systemctl restart nats-server"
#: A new account reaches the buckets only after the second reload of nats-server (2.9.10, 2.15.1).
_RELOAD: Final = "sudo systemctl reload nats-server && sleep 5 && sudo systemctl reload nats-server"

_AT_SITE: Final = """
At each new site, with its own {creds}:
  sudo install -D -g dialout -m 640 {creds} /etc/modbus-gateway/fleet.creds
and in its config:
  site = "{site}"
  [fleet]
  servers     = ["{server}"]
  credentials = "/etc/modbus-gateway/fleet.creds\""""

#: Others are in that group, too: where a key may ask all sites, only root reads it, and systemd hands it over.
_AT_CONTROL: Final = """
At {sites}, where the key may ask all sites, this instead:
  sudo install -D -m 600 {creds} /etc/modbus-gateway/fleet.creds
in its config:
  credentials = {{ credential = "fleet" }}
and with `sudo systemctl edit modbus-gateway`:
  [Service]
  LoadCredential=fleet:/etc/modbus-gateway/fleet.creds"""

_AT_LEAF: Final = """
At sites with a leaf node ({sites}), servers = ["nats://127.0.0.1:4222"], and:
  sudo install -o nats -g nats -m 600 {config} /etc/nats-server.conf
  sudo systemctl restart nats-server"""


def hub_text(hub: Hub, written: Written) -> str:
    """Say what was written, and what to do next."""
    return "\n".join(_lines(hub, written))


def _lines(hub: Hub, written: Written) -> Iterator[str]:
    folder = written.folder
    yield f"{folder / CONFIG} has {len(sites_of(hub))} sites; {', '.join(hub.control)} may ask all others."
    if written.new:
        yield f"New: {_named(written.new, CREDENTIALS)}. Each is a secret key; once it is at its site, delete it here."
    if written.removed:
        yield f"Removed: {_named(written.removed)}. After a reload the hub refuses their keys."
    if written.useless:
        yield f"Not used any more, and can be deleted: {_named(written.useless)}."
    yield _AT_HUB.format(config=folder / CONFIG, load=_RELOAD if written.kept else _RESTART)
    if written.new:
        yield _AT_SITE.format(site="SITE", creds=f"SITE{CREDENTIALS}", server=_server(hub)) + _authority(hub)
    if control := [name for name in hub.control if name in written.new]:
        yield _AT_CONTROL.format(sites=_named(control), creds=f"SITE{CREDENTIALS}")
    if hub.leaf_nodes:
        yield _AT_LEAF.format(sites=_named(hub.leaf_nodes), config=f"SITE{LEAF_CONFIG}")
    if hub.certificate is None and hub.listen is None:
        yield "\nWithout certificate and key, only programs on the machine of the hub reach it: docs/fleet.md."


def _server(hub: Hub) -> str:
    scheme = "nats" if hub.certificate is None else "tls"
    address = hub.address or hub.listen
    if address is None:
        return f"{scheme}://{'127.0.0.1' if hub.certificate is None else 'HUB'}:4222"
    host = f"[{address.host}]" if ":" in address.host else address.host
    return f"{scheme}://{'HUB' if address.is_wildcard else host}:{address.port}"


def _authority(hub: Hub) -> str:
    return "" if hub.ca is None else f'\n  ca          = "{hub.ca}"'


def _named(names: Sequence[str], ending: str = "") -> str:
    shown = ", ".join(f"{name}{ending}" for name in names[:_MOST_NAMES])
    more = len(names) - _MOST_NAMES
    return f"{shown} and {more} more" if more > 0 else shown
