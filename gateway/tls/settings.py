"""The files that the config names: secrets, and the certificates of addresses."""

from dataclasses import dataclass
from typing import NamedTuple


@dataclass(frozen=True, slots=True)
class SecretFile:
    """A file by its path, or by the name of a credential that systemd hands to the service (systemd.exec(5))."""

    name: str
    is_credential: bool = False


@dataclass(frozen=True, slots=True)
class ServerTls:
    """TLS of an address where clients connect."""

    certificate: SecretFile
    key: SecretFile
    #: The authority that must have signed each client's certificate, and its revocation list.
    clients_ca: SecretFile | None = None
    crl: SecretFile | None = None


@dataclass(frozen=True, slots=True)
class ClientTls:
    """TLS of a connection to a server."""

    #: The gateway's own certificate, if any.
    certificate: SecretFile | None
    key: SecretFile | None
    #: The authority of the server's certificate; None for any that the system trusts.
    ca: SecretFile | None
    #: The name that the server's certificate must be for.
    server_name: str


#: The settings of any address.
TlsSettings = ServerTls | ClientTls


class Secured(NamedTuple):
    """An address of the config with TLS. `name` is its table and its name: `listen remote`."""

    name: str
    source: str
    settings: TlsSettings
