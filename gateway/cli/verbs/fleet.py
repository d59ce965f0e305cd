"""`fleet`: the config of the NATS server of a fleet, and the logins of its sites."""

import argparse
import json
import sys
from pathlib import Path
from typing import Final

from gateway.cli.kit.usage import WrongUsageError
from gateway.cli.main import FINE, PROBLEM_FOUND
from gateway.cli.show.hub import hub_text
from gateway.config.machine.file_text import UnreadableFile, read_file_text
from gateway.config.problem import Problem, did_you_mean, error
from gateway.config.reading.hub_file import HubFile, parse_hub_file
from gateway.config.schema.hub import Hub
from gateway.fleet.hub.config import sites_of
from gateway.fleet.hub.folder import CONFIG, write_folder

_ABOUT: Final = """\
FILE is TOML:

  control = "control"             the site that may ask all others, or a list
  sites   = ["east", "north"]     all others
  asks    = { east = ["north"] }  which of them may ask which

docs/fleet.md has the other keys. Run it again after each change of FILE: what
exists stays. Beside FILE it writes hub/hub.conf, hub/SITE.creds for each site,
and hub/SITE.leaf.conf for each site with a leaf node.
"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of `fleet`."""
    parser.epilog = _ABOUT
    verbs = parser.add_subparsers(dest="what", metavar="hub", required=True)
    verb = verbs.add_parser("hub", help="write the config of the NATS server, and a login for each site")
    verb.add_argument("file", metavar="FILE", help="the sites, and who asks whom (TOML)")
    verb.add_argument("--renew", metavar="SITE", help="give this site a new key: the old one is refused afterwards")
    verb.add_argument("--json", action="store_true", help="print JSON instead of text")


def run(args: argparse.Namespace) -> int:
    """Write the folder `hub`, and say what to do next; 1 if the file has a problem.

    Raises:
        FleetError: a file in the folder is not what it must be, or the signing library is not installed.
    """
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
        return HubFile(None, (_unreadable(file, wrong),))


def _unreadable(file: Path, wrong: UnreadableFile) -> Problem:
    return error((), str(wrong), wrong.remedy).located(str(file), wrong.line, min(wrong.line, 1))


def _check_renewed(site: str | None, hub: Hub) -> None:
    sites = sites_of(hub)
    if site is not None and site not in sites:
        raise WrongUsageError(f'there is no site "{site}"', did_you_mean(site, sites))
