"""The files that secure one address of the config."""

from dataclasses import dataclass
from typing import NamedTuple

from gateway.tls.secret_file import SecretFile


@dataclass(frozen=True, slots=True)
class ServerTls:
    """Where clients come in. With `clients_ca` each must show a certificate of that authority.

    `crl` names the certificates that the authority has revoked.
    """

    certificate: SecretFile
    key: SecretFile
    clients_ca: SecretFile | None = None
    crl: SecretFile | None = None


@dataclass(frozen=True, slots=True)
class ClientTls:
    """A server that the gateway connects to: its certificate must be of the authority `ca`, and for `server_name`.

    Without `ca` it may be of any authority that the system trusts. The gateway shows its own `certificate`, if any.
    """

    certificate: SecretFile | None
    key: SecretFile | None
    ca: SecretFile | None
    server_name: str


#: What secures any address.
TlsSettings = ServerTls | ClientTls


class Secured(NamedTuple):
    """An address of the config that TLS secures. `name` is its table and its name: `listen remote`."""

    name: str
    source: str
    settings: TlsSettings
