"""The keys of `[[upstream]]`, and of the units behind it."""

from typing import Annotated

from pydantic import Field

from gateway.config.schema.table import Table
from gateway.config.values.key_types import (
    CredentialFile,
    Duration,
    ListOf,
    Name,
    OtherServer,
    Units,
    UnitsFrom0,
)


class UpstreamUnit(Table):
    """Units behind another server."""

    known_as: Units = Field(alias="as", description="Their unit IDs for clients, 1-255.")
    units: UnitsFrom0 = Field(alias="unit", description="The units that the other server knows.")


class Upstream(Table):
    """Another Modbus TCP server, and the units behind it."""

    name: Name | None = Field(None, description="Its name in logs. Default: the address.")
    to: OtherServer = Field(
        description="Its address: `tcp://`, or `tls://` for a server with Modbus/TCP Security. Default port: 502, with "
        "`tls://` 802. Or `fleet://SITE` for the gateway of another site, with [`[fleet]`](fleet.md)."
    )
    units: Annotated[tuple[UpstreamUnit, ...], ListOf] | None = Field(
        None,
        description="The units behind it. This key may be left out if a `[[listen]]` names the upstream; only such "
        "listeners then lead to it.",
    )
    timeout: Duration = Field(1.0, description="How long a response may take.")
    in_flight: Annotated[int, Field(ge=1, le=64)] = Field(
        16, description="Requests in progress at once; 1 for a server that can only handle one."
    )
    certificate: CredentialFile | None = Field(
        None, description="With `tls://`: the file with the certificate that the gateway shows, and its chain (PEM)."
    )
    key: CredentialFile | None = Field(
        None, description="With `tls://`: the file with its private key (PEM); only its owner and group may read it."
    )
    ca: CredentialFile | None = Field(
        None,
        description="With `tls://`: the file with the certificates of the authorities of the server (PEM).",
    )
    server_name: Name | None = Field(
        None,
        description="With `tls://`: the name or address in the certificate of the server. Default: the host in `to`.",
    )

    @property
    def label(self) -> str:
        """Give its name, or its default name."""
        return self.name or str(self.to)
