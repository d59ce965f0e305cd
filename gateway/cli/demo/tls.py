"""`demo --tls`: a secured listener with certificates that live as long as the demo."""

from pathlib import Path
from typing import Final

from gateway.tls.making import make_authority, make_client, make_server

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
