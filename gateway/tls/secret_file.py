"""A file with a secret, as the config names it."""

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class SecretFile:
    """A file by its path, or by the name of a credential that systemd hands to the service (systemd.exec(5))."""

    name: str
    is_credential: bool = False
