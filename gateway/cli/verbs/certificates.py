"""`certificates`: an authority of one's own, and what it signs."""

import argparse
import json
from datetime import UTC, datetime
from pathlib import Path
from typing import Final

from gateway.cli.kit.columns import align
from gateway.cli.kit.usage import WrongUsageError
from gateway.cli.main import FINE
from gateway.tls.certificate import WrongRole, shorten
from gateway.tls.files import read_certificates
from gateway.tls.making import AUTHORITY_DAYS, OTHER_DAYS, is_plain, make_authority, make_client, make_server
from gateway.tls.revoking import Issued, find_issued, find_replaced, read_revoked, revoke
from gateway.tls.workshop import AUTHORITY

#: Where the files are put.
DEFAULT_FOLDER: Final = "/etc/modbus-gateway/tls"

_COLUMNS: Final = ("file", "subject", "role", "until", "state")

_ABOUT: Final = """\
Each certificate NAME.crt has its key beside it, NAME.key, which only its owner
can read. The key of the authority, ca.key, makes certificates that every
gateway accepts: keep it on another machine.
"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of `certificates`."""
    parser.epilog = _ABOUT
    verbs = parser.add_subparsers(dest="what", metavar="authority|server|client|revoke|list", required=True)
    verb = verbs.add_parser("authority", help="make an authority")
    verb.add_argument("--name", default="Modbus gateway authority", help='its name (default "%(default)s")')
    _add_common(verb, AUTHORITY_DAYS)
    verb = verbs.add_parser("server", help="make a certificate for a server: a gateway, or its web page")
    verb.add_argument("names", nargs="+", metavar="NAME", help="the names and addresses that its clients use")
    verb.add_argument("--file", default="server", metavar="STEM", help="the name of its files (default %(default)s)")
    verb.add_argument("--replace", action="store_true", help="replace those that exist")
    _add_common(verb, OTHER_DAYS)
    verb = verbs.add_parser("client", help="make one for a client")
    verb.add_argument("name", metavar="NAME", help="its name, and that of its files")
    verb.add_argument("--role", help="its role, as in [[access]]; without it the null role")
    verb.add_argument("--replace", action="store_true", help="replace those that exist")
    _add_common(verb, OTHER_DAYS)
    verb = verbs.add_parser("revoke", help="put certificates on the revocation list, ca.crl")
    verb.add_argument("name", metavar="NAME", help="a name: all certificates issued to it; or the file of one")
    verb.add_argument("--replaced", action="store_true", help="only those that --replace has replaced")
    _add_common(verb)
    verb = verbs.add_parser("list", help="list the certificates in the folder")
    verb.add_argument("--json", action="store_true", help="print JSON instead of a table")
    _add_common(verb)


def run(args: argparse.Namespace) -> int:
    """Make, revoke or list certificates; 2 for wrong usage."""
    makers = {"authority": _authority, "server": _server, "client": _client, "revoke": _revoke, "list": _list}
    makers[args.what](Path(args.folder), args)
    return FINE


def _add_common(parser: argparse.ArgumentParser, days: int | None = None) -> None:
    parser.add_argument("--folder", default=DEFAULT_FOLDER, help="the folder of the files (default %(default)s)")
    if days is not None:
        parser.add_argument("--days", type=_days, default=days, help="how many days it is valid (default %(default)s)")


def _days(text: str) -> int:
    if not text.isdecimal() or not 1 <= int(text) <= AUTHORITY_DAYS:
        raise argparse.ArgumentTypeError(f"must be 1 to {AUTHORITY_DAYS}")
    return int(text)


def _authority(folder: Path, args: argparse.Namespace) -> None:
    made = make_authority(folder, _plain(args.name), args.days)
    print(f"{made} is the authority, for {args.days} days. Its key, {made.with_suffix('.key')}, must stay secret.")
    print(f'Gateways and clients trust what it signs by that file: clients_ca = "{made}"')


def _server(folder: Path, args: argparse.Namespace) -> None:
    names = [_plain(name) for name in args.names]
    made = make_server(folder, _stem(args.file), names, args.days, replace=args.replace)
    print(f"{made} is for {', '.join(names)}, for {args.days} days.")
    print(f'certificate = "{made}"\nkey = "{made.with_suffix(".key")}"')
    _tell_replaced(folder, args.file)


def _client(folder: Path, args: argparse.Namespace) -> None:
    role = None if args.role is None else _plain(args.role)
    made = make_client(folder, _stem(args.name), role, args.days, replace=args.replace)
    has = "has no role" if role is None else f'has the role "{role}"'
    print(f"{made} {has}, for {args.days} days. The client needs it, {made.with_suffix('.key').name} and ca.crt.")
    _tell_replaced(folder, args.name)


def _tell_replaced(folder: Path, stem: str) -> None:
    """Say that what was replaced can still be used by anybody who has its key."""
    last = max(find_replaced(folder, stem), key=lambda each: each.certificate.not_after, default=None)
    if last is not None:
        at_folder = "" if str(folder) == DEFAULT_FOLDER else f" --folder {folder}"
        print(
            f"What it replaces is valid until {_date(last.certificate.not_after)}. If somebody else may have its key:\n"
            f"  modbus-gateway certificates revoke {stem} --replaced{at_folder}"
        )


def _revoke(folder: Path, args: argparse.Namespace) -> None:
    found = _meant(folder, args)
    gone = read_revoked(folder)
    made = revoke(folder, [each.file for each in found])
    for each in found:
        serial = each.certificate.serial
        state = "was revoked before" if serial in gone else f"is revoked, serial number {serial}"
        print(f"{each.file} {state}")
    print(f'It is refused where crl = "{made}", after: modbus-gateway reload')


def _meant(folder: Path, args: argparse.Namespace) -> list[Issued]:
    """Find the certificates that are to be revoked."""
    if args.name.endswith(".crt"):
        file = Path(args.name)
        return [Issued(file, read_certificates(file)[0])]
    stem = _stem(args.name)
    found = find_replaced(folder, stem) if args.replaced else find_issued(folder, stem)
    if not found:
        what = "nothing that was replaced is valid" if args.replaced else f"there is no {folder / stem}.crt"
        raise WrongUsageError(f"{stem}: {what}", "modbus-gateway certificates list names those in the folder")
    return found


def _list(folder: Path, args: argparse.Namespace) -> None:
    rows, gone = [], read_revoked(folder)
    for file in sorted(folder.glob("*.crt")):
        certificate = read_certificates(file)[0]
        try:
            role = certificate.role
        except WrongRole as wrong:
            role = f"({wrong})"
        state = "revoked" if certificate.serial in gone else ""
        rows.append((str(file), shorten(certificate.subject), role, _date(certificate.not_after), state))
    if args.json:
        print(json.dumps([dict(zip(_COLUMNS, row, strict=True)) for row in rows], indent=2))
    elif rows:
        print(align([tuple(map(str.upper, _COLUMNS)), *rows]))
    else:
        print(f"{folder} has no certificates")


def _date(moment: float) -> str:
    return datetime.fromtimestamp(moment, UTC).strftime("%Y-%m-%d")


def _stem(name: str) -> str:
    if name in (AUTHORITY, ".", "..") or "/" in name:
        raise WrongUsageError(f'"{name}" cannot be the name of these files')
    return _plain(name)


def _plain(text: str) -> str:
    if not is_plain(text):
        what = f'"{text}" cannot be put into a certificate by this command'
        raise WrongUsageError(what, "up to 64 letters, digits, spaces, and . _ : @ + - (openssl can do more)")
    return text
