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
