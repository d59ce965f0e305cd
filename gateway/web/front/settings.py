"""Where the server listens, and who is let in."""

import ssl
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from ipaddress import IPv4Network, IPv6Network
from pathlib import Path


@dataclass(frozen=True, slots=True)
class WebSettings:
    """The settings of the server. Without `users` nobody can log in; with `tls` it is https://.

    `hosts` are names by which it may be called. Programs that send the `token` may read. Requests of a `proxy` name
    their user in X-Forwarded-User. Operators may `write` if that is set. `tls` gives the context of a connection that
    begins.
    """

    host: str
    port: int
    hosts: tuple[str, ...] = ()
    token: str = field(default="", repr=False)
    users: Path | None = None
    tls: Callable[[], ssl.SSLContext] | None = None
    proxy: tuple[IPv4Network | IPv6Network, ...] = ()
    write: bool = False

    @property
    def is_encrypted(self) -> bool:
        """Whether it is https://."""
        return self.tls is not None


#: On every response. The page loads nothing from elsewhere, runs nothing that stands in it, and is shown in no frame.
#: (Referrer-Policy: no-referrer would make browsers send `Origin: null` with forms.)
HEADERS: Mapping[str, str] = {
    "Content-Security-Policy": (
        "default-src 'self'; base-uri 'none'; form-action 'self'; frame-ancestors 'none'; object-src 'none'"
    ),
    "Cross-Origin-Opener-Policy": "same-origin",
    "Cross-Origin-Resource-Policy": "same-origin",
    "Referrer-Policy": "same-origin",
    "Server": "modbus-gateway",
    "X-Content-Type-Options": "nosniff",
}
