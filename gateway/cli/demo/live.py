"""What those see who stay: lines where something goes wrong now and then or values move, and a user who may write."""

import secrets
from pathlib import Path
from typing import Final, NamedTuple

from gateway.cli.demo.script import DemoLine
from gateway.readconfig.page_users import User, changing_users, hashed
from gateway.tls.making import make_authority, make_client, make_server

#: Noise, another client, a device that is off.
_HALL: Final = DemoLine(
    "hall",
    (
        *("generic:10-14", "weigher:1"),
        *("--moving-unit", "1", "--silent-unit", "14", "--noise", "3%", "--fault", "second-client"),
    ),
    "baud = 19200\n"
    'devices = [{ unit = 1, as = 61, name = "mixer", profile = "weigher" },\n'
    '           { unit = "11-13", as = "71-73", name = "drive-*", timeout = "150 ms" },\n'
    '           { unit = 14, as = 74, name = "spare", timeout = "250 ms" }]',
)

#: Powers and temperatures that move, energies that count up.
_METERS: Final = DemoLine(
    "meters",
    ("eastron-sdm630:1", "eastron-sdm120:2", "xy-md02:5", "--format", "8N1"),
    "baud = 9600\n"
    'format = "8N1"\n'
    'devices = [{ unit = 1, as = 81, name = "meter-hall", profile = "eastron-sdm630" },\n'
    '           { unit = 2, as = 82, name = "meter-lab", profile = "eastron-sdm120" },\n'
    '           { unit = 5, as = 85, name = "climate", profile = "xy-md02" }]',
)

#: Who may log in at the page.
USER: Final = "demo"

LIVE_LINES: Final = (_HALL, _METERS)

#: Rows for the virtual unit of the script.
LIVE_MAPPED: Final = (
    '{ at = 16, device = "mixer", point = "weight", every = "1 s" }',
    '{ at = 18, device = "drive-71", holding = "0-3", every = "1 s" }',
    '{ at = 22, device = "drive-72", holding = "0-3", every = "1 s" }',
    '{ at = 26, device = "drive-73", holding = "0-3", every = "1 s" }',
    '{ at = 30, device = "spare", holding = 0, every = "1 s" }',
    '{ at = 31, fresh = ["mixer", "drive-71", "drive-72", "drive-73", "spare"] }',
)
#: The port of the secured listener, if it is free.
PORT: Final = 8802
_DAYS: Final = 2

_CONFIG: Final = """\
[[listen]]
name = "secured"
bind = "tls://127.0.0.1:{port}"
certificate = "{folder}/server.crt"
key = "{folder}/server.key"
clients_ca = "{folder}/ca.crt"

[[access]]
role = "operator"
allow = ["read", "write"]

[[access]]
role = "viewer"
allow = ["read"]

[[access]]
from = ["127.0.0.0/8", "::1"]
allow = ["read", "write"]
"""


class Login(NamedTuple):
    """A user of the demo's page, whose password only this run of the demo knows."""

    file: Path
    user: str
    password: str


def make_login(folder: Path) -> Login:
    """Make the file of users in a folder, with one operator."""
    login = Login(folder / "users", USER, secrets.token_hex(5))
    with changing_users(login.file) as users:
        users[login.user] = User(login.user, "operator", hashed(login.password))
    return login


def page_config(port: int, login: Login) -> str:
    """Write the table of the page, which only this machine can reach."""
    return f'[web]\nbind = "http://127.0.0.1:{port}"\nusers = "{login.file}"\nwrite = true\n'


def make_certificates(folder: Path) -> Path:
    """Make an authority, a server and two clients in a folder there.

    Raises:
        TlsError: they cannot be made.
    """
    tls = folder / "tls"
    make_authority(tls, "Demo authority", _DAYS)
    make_server(tls, "server", ["localhost", "127.0.0.1"], _DAYS)
    for role in ("operator", "viewer"):
        make_client(tls, role, role, _DAYS)
    return tls


def tls_config(tls: Path, port: int) -> str:
    """Write the listener and the rights of roles for the config."""
    return _CONFIG.format(folder=tls, port=port)


def invitation(tls: Path, address: str) -> str:
    """Say how to connect, and how to write 7 to register 0 of unit 200: the response to a viewer is exception 01."""
    place = address.removeprefix("tls://")
    return (
        f"\nThe same units with certificates, at {address}. A viewer may not write: his request is\n"
        "answered with 86 01. That of an operator (operator.crt, operator.key) comes back as it is:\n"
        r"  (printf '\0\1\0\0\0\6\310\6\0\0\0\7'; sleep 1) |"
        f" openssl s_client -quiet -connect {place} \\\n"
        f"    -CAfile {tls}/ca.crt -cert {tls}/viewer.crt -key {tls}/viewer.key 2>/dev/null | xxd"
    )
