"""`fleet`: the config of the NATS server of a fleet, and the logins of its sites."""

import argparse
import json
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Final

from gateway.cli.kit.usage import WrongUsageError
from gateway.cli.main import FINE, PROBLEM_FOUND
from gateway.config.machine.file_text import UnreadableFile, read_file_text
from gateway.config.problem import did_you_mean, listed
from gateway.config.reading.hub_file import HubFile, parse_hub_file
from gateway.config.schema.hub import Hub
from gateway.fleet.hub.config import sites_of
from gateway.fleet.hub.folder import CONFIG, CREDENTIALS, LEAF_CONFIG, Written, write_folder

_ABOUT: Final = """\
FILE is TOML:

  control = "control"             the site that may ask all others, or a list
  sites   = ["east", "north"]     all others
  asks    = { east = ["north"] }  which of them may ask which

docs/fleet.md has the other keys. Run it again after each change of FILE: what
exists stays. Beside FILE it writes hub/hub.conf, hub/SITE.creds for each site,
and hub/SITE.leaf.conf for each site with a leaf node.
"""
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


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of `fleet`."""
    parser.epilog = _ABOUT
    verbs = parser.add_subparsers(dest="what", metavar="hub", required=True)
    verb = verbs.add_parser("hub", help="write the config of the NATS server, and a login for each site")
    verb.add_argument("file", metavar="FILE", help="the sites, and who asks whom (TOML)")
    verb.add_argument("--renew", metavar="SITE", help="give this site a new key: the old one is refused afterwards")
    verb.add_argument("--json", action="store_true", help="print JSON instead of text")


def run(args: argparse.Namespace) -> int:
    """Write the folder `hub`, and say what to do next; 1 if the file has a problem."""
    file = Path(args.file)
    read = _read(file)
    for problem in read.problems:
        print(problem, file=sys.stderr)
    if read.hub is None:
        return PROBLEM_FOUND
    _check_renewed(args.renew, read.hub)
    written = write_folder(file, read.hub, args.renew)
    if args.json:
        lists = {"new": written.new, "away": written.away, "removed": written.removed, "useless": written.useless}
        config = str(written.folder / CONFIG)
        print(json.dumps({"config": config, "sites": sites_of(read.hub), **lists}, indent=2))
    else:
        print(hub_text(read.hub, written))
    return FINE


def _read(file: Path) -> HubFile:
    try:
        return parse_hub_file(read_file_text(file), str(file))
    except UnreadableFile as wrong:
        return HubFile(None, (wrong.problem(file),))


def _check_renewed(site: str | None, hub: Hub) -> None:
    sites = sites_of(hub)
    if site is not None and site not in sites:
        raise WrongUsageError(f'there is no site "{site}"', did_you_mean(site, sites))


def hub_text(hub: Hub, written: Written) -> str:
    """Say what was written, and what to do next."""
    return "\n".join(_lines(hub, written))


def _lines(hub: Hub, written: Written) -> Iterator[str]:
    folder = written.folder
    yield f"{folder / CONFIG} has {len(sites_of(hub))} sites; {', '.join(hub.control)} may ask all others."
    if written.new:
        new = listed([f"{name}{CREDENTIALS}" for name in written.new], _MOST_NAMES)
        yield f"New: {new}. Each is a secret key; once it is at its site, delete it here."
    if written.removed:
        yield f"Removed: {listed(written.removed, _MOST_NAMES)}. After a reload the hub refuses their keys."
    if written.useless:
        yield f"Not used any more, and can be deleted: {listed(written.useless, _MOST_NAMES)}."
    yield _AT_HUB.format(config=folder / CONFIG, load=_RELOAD if written.kept else _RESTART)
    if written.new:
        yield _AT_SITE.format(site="SITE", creds=f"SITE{CREDENTIALS}", server=_server(hub)) + _authority(hub)
    if control := [name for name in hub.control if name in written.new]:
        yield _AT_CONTROL.format(sites=listed(control, _MOST_NAMES), creds=f"SITE{CREDENTIALS}")
    if hub.leaf_nodes:
        yield _AT_LEAF.format(sites=listed(hub.leaf_nodes, _MOST_NAMES), config=f"SITE{LEAF_CONFIG}")
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
