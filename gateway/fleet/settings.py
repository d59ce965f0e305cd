"""The NATS servers, and the login of a site's gateway there."""

from dataclasses import dataclass
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    import ssl


@dataclass(frozen=True, slots=True)
class Server:
    """Address of a NATS server. With `is_encrypted` only TLS is used."""

    host: str
    port: int
    is_encrypted: bool = False

    def __str__(self) -> str:
        host = f"[{self.host}]" if ":" in self.host else self.host
        return f"{'tls' if self.is_encrypted else 'nats'}://{host}:{self.port}"


@dataclass(frozen=True, slots=True)
class Login:
    """The login of the gateway of `site`: user and password, or the text of a credentials file."""

    site: str
    user: str | None = None
    password: str | None = None
    credentials: str | None = None
    context: "ssl.SSLContext | None" = None
    server_name: str = ""
