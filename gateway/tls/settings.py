"""Files as the config names them: those with a secret, and those that secure an address."""

from dataclasses import dataclass
from typing import NamedTuple


@dataclass(frozen=True, slots=True)
class SecretFile:
    """A file by its path, or by the name of a credential that systemd hands to the service (systemd.exec(5))."""

    name: str
    is_credential: bool = False


@dataclass(frozen=True, slots=True)
class ServerTls:
    """An address where clients connect."""

    certificate: SecretFile
    key: SecretFile
    #: The authority of which each client must show a certificate, and the list of those that it has revoked.
    clients_ca: SecretFile | None = None
    crl: SecretFile | None = None


@dataclass(frozen=True, slots=True)
class ClientTls:
    """A server that the gateway connects to."""

    #: What the gateway shows, if anything.
    certificate: SecretFile | None
    key: SecretFile | None
    #: The authority of the server's certificate; None for any that the system trusts.
    ca: SecretFile | None
    #: The name that the server's certificate must be for.
    server_name: str


#: What secures any address.
TlsSettings = ServerTls | ClientTls


class Secured(NamedTuple):
    """An address of the config that TLS secures. `name` is its table and its name: `listen remote`."""

    name: str
    source: str
    settings: TlsSettings
