"""The keys of `[fleet]`."""

from typing import Literal

from pydantic import Field

from gateway.config.schema.table import Table
from gateway.config.values.key_types import CredentialFile, LeaseDuration, Name, NatsServers, PasswordFile


class Fleet(Table):
    """The other gateways of a fleet, over NATS; without this table there are none. See [fleet](fleet.md)."""

    servers: NatsServers = Field(
        description="NATS servers, of which one is used: `nats://` or `tls://`. Default port: 4222."
    )
    credentials: CredentialFile | None = Field(
        None, description="The credentials file of a NATS user (JWT and seed); only its owner and group may read it."
    )
    user: Name | None = Field(None, description="Or the name with which the gateway logs in.")
    password: PasswordFile | None = Field(
        None, description="The file with its password; only its owner and group may read it."
    )
    lease: LeaseDuration = Field(5.0, description="How long the `lease` of a line lasts if nobody renews it.")
    fallback: Literal["release", "hold"] = Field(
        "release",
        description="What the holder of a lease does when it cannot reach NATS. `release`: it stops sending requests "
        "before another can have the lease. `hold`: it goes on, so two gateways may ask on one line.",
    )
    ca: CredentialFile | None = Field(
        None,
        description="With `tls://`: the file with the certificates of the authorities of the servers (PEM). Default: "
        "those that the system trusts.",
    )
    certificate: CredentialFile | None = Field(
        None, description="With `tls://`: the file with the certificate that the gateway shows, and its chain (PEM)."
    )
    key: CredentialFile | None = Field(
        None,
        description="With `tls://`: the file with its private key (PEM); only its owner and group may read it.",
    )
