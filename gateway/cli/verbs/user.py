"""`user`: who may log in at the web page, and programs with a token."""

import argparse
import getpass
import json
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any, Final

from gateway.cli.kit.columns import align
from gateway.cli.kit.usage import WrongUsageError
from gateway.cli.main import DEFAULT_CONFIG, FINE
from gateway.config.machine.file_text import folder_of
from gateway.config.machine.included import written_in
from gateway.config.problem import did_you_mean
from gateway.errors import UsersError
from gateway.readconfig.page_users import (
    ROLES,
    User,
    changing_users,
    hashed,
    is_user_name,
    new_token,
    password_trouble,
    read_users,
    token_hash,
)

#: Where the users are when no config says it.
DEFAULT_FILE: Final = "/etc/modbus-gateway/users"

_WHATS: Final = ("add", "remove", "list", "password")

_ABOUT: Final = """\
A viewer reads; an operator also reloads the config, and writes if [web] has
write = true. A running gateway knows of a change within 5 s, and ends the
sessions of users that were changed or removed. A token is shown once; programs
send it as `Authorization: Bearer TOKEN`, and may what its role may.
"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of `user`."""
    parser.epilog = _ABOUT
    _let_a_name_with_token_mean_add(parser)
    verbs = parser.add_subparsers(dest="what", metavar="|".join(_WHATS), required=True)
    for what, about in (("add", "add a user"), ("remove", "remove one"), ("password", "set another password")):
        verb = verbs.add_parser(what, help=about)
        verb.add_argument("name", help="letters, digits, and . _ @ - after the first character")
        if what == "add":
            verb.add_argument("--role", choices=ROLES, default="viewer", help="what the user may do (default viewer)")
            verb.add_argument("--token", action="store_true", help="make a token for a program, instead of a password")
        _add_file_argument(verb)
    verb = verbs.add_parser("list", help="list all")
    verb.add_argument("--json", action="store_true", help="print JSON instead of a table")
    _add_file_argument(verb)


def _let_a_name_with_token_mean_add(parser: argparse.ArgumentParser) -> None:
    """Take `NAME --token` as `add NAME --token`."""
    plain = parser.parse_known_args

    def parse(args: Sequence[str], namespace: Any = None) -> Any:
        is_name = "--token" in args and args[0] not in _WHATS
        return plain(["add", *args] if is_name else args, namespace)

    setattr(parser, "parse_known_args", parse)  # noqa: B010 - a method of one parser


def run(args: argparse.Namespace) -> int:
    """Change or list the users; 2 for wrong usage."""
    file = Path(args.file or _file_of_config() or DEFAULT_FILE)
    try:
        return {"add": _add, "remove": _remove, "password": _password, "list": _list}[args.what](file, args)
    except OSError as error:
        raise UsersError(f"{error.filename or file}: {error.strerror or error}") from error


def _add_file_argument(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "--file", metavar="FILE", help=f"the file (default: as {DEFAULT_CONFIG} says, or {DEFAULT_FILE})"
    )


def _add(file: Path, args: argparse.Namespace) -> int:
    if not is_user_name(args.name):
        raise WrongUsageError(f'"{args.name}" is not a valid user name', "1 to 64 letters, digits, and . _ @ -")
    with changing_users(file) as users:
        if args.name in users:
            other = "remove" if args.token or users[args.name].is_program else "password"
            raise WrongUsageError(f"{args.name} is there already", f"modbus-gateway user {other} {args.name}")
        token = new_token() if args.token else ""
        hash_ = token_hash(token) if token else hashed(_new_password(args.name))
        users[args.name] = User(args.name, args.role, hash_)
    if token:
        print(token, flush=True)  # alone on standard output, to be written into a file
    said = f"{args.name} ({args.role}) was added to {file}"
    print(f"{said}; its token is shown only now" if token else said, file=sys.stderr if token else sys.stdout)
    return FINE


def _password(file: Path, args: argparse.Namespace) -> int:
    with changing_users(file) as users:
        user = _known(args.name, users)
        if user.is_program:
            renewed = f"modbus-gateway user {user.name} --token --role {user.role}"
            raise WrongUsageError(f"{user.name} has a token, no password", f"remove it, then {renewed}")
        users[user.name] = User(user.name, user.role, hashed(_new_password(user.name)))
    print(f"{args.name} has another password now")
    return FINE


def _remove(file: Path, args: argparse.Namespace) -> int:
    with changing_users(file) as users:
        del users[_known(args.name, users).name]
    print(f"{args.name} was removed from {file}")
    return FINE


def _list(file: Path, args: argparse.Namespace) -> int:
    users = sorted(read_users(file).values(), key=lambda user: user.name) if file.exists() else []
    if args.json:
        print(
            json.dumps([{"user": each.name, "role": each.role, "token": each.is_program} for each in users], indent=2)
        )
    elif users:
        rows = ((each.name, each.role, "token" if each.is_program else "password") for each in users)
        print(align([("USER", "ROLE", "PROVED BY"), *rows]))
    else:
        print(f"{file} has no users")
    return FINE


def _known(name: str, users: dict[str, User]) -> User:
    if name not in users:
        raise WrongUsageError(f"there is no user {name}", did_you_mean(name, users))
    return users[name]


def _new_password(name: str) -> str:
    """Ask for a password, twice, or read the first line of standard input."""
    if sys.stdin.isatty():
        password = getpass.getpass(f"Password for {name}: ")
        if password != getpass.getpass("Again: "):
            raise WrongUsageError("the two passwords differ")
    else:
        password = sys.stdin.readline().rstrip("\r\n")
    if trouble := password_trouble(password):
        raise WrongUsageError(f"the password cannot be used: {trouble}")
    return password


def _file_of_config() -> str:
    """Find the file that the service's config names; empty if it names none."""
    users, file = written_in(Path(DEFAULT_CONFIG), "web", "users")
    return str(folder_of(file) / users) if users else ""
