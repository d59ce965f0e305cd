"""Where the NATS servers are, and how the gateway of a site logs in there."""

from dataclasses import dataclass
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    import ssl


@dataclass(frozen=True, slots=True)
class Server:
    """Where a NATS server is. With `is_encrypted` the connection is one of TLS, or there is none."""

    host: str
    port: int
    is_encrypted: bool = False

    def __str__(self) -> str:
        host = f"[{self.host}]" if ":" in self.host else self.host
        return f"{'tls' if self.is_encrypted else 'nats'}://{host}:{self.port}"


@dataclass(frozen=True, slots=True)
class Login:
    """How the gateway of `site` logs in: with user and password, or with the text of a credentials file."""

    site: str
    user: str | None = None
    password: str | None = None
    credentials: str | None = None
    context: "ssl.SSLContext | None" = None
    server_name: str = ""
