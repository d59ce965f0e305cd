"""The keys of `[[upstream]]`."""

from typing import Annotated, Literal

from pydantic import Field

from gateway.config.schema.device import Device
from gateway.config.schema.table import Count, Table
from gateway.config.values.key_types import (
    CredentialFile,
    Duration,
    DurationOrOffOrAuto,
    DurationOrZero,
    ListOf,
    LongerDuration,
    Name,
    OtherServers,
)


class Upstream(Table):
    """Another Modbus TCP server, and the units behind it."""

    name: Name | None = Field(None, description="Its name in logs. Default: the first address.")
    to: OtherServers = Field(
        description="Its address: `tcp://`, or `tls://` for a server with Modbus/TCP Security. Default port: 502, with "
        "`tls://` 802. Or `fleet://SITE` for the gateway of another site, with [`[fleet]`](fleet.md). Several "
        "addresses of the same server are a list: the next one is tried when one cannot be reached, or when three "
        "requests in a row have timed out and nothing came from it. Two servers of which one stands in for the other "
        "are two upstreams.",
    )
    units: Annotated[tuple[Device, ...], ListOf] | None = Field(
        None,
        description="The units behind it. This key may be left out if a `[[listen]]` names the upstream; only such "
        "listeners then lead to it.",
    )
    profile: str = Field("generic", description="The profile of units without their own.")
    timeout: Duration | None = Field(
        None,
        description="How long a response of units without their own profile may take, for functions without a row in "
        "`timing`. Default: the `timeout` of `profile` (`generic`: 1 s).",
    )
    in_flight: Annotated[int, Field(ge=1, le=64)] = Field(
        16, description="Requests in progress at once; 1 for a server that can only handle one."
    )
    gap: DurationOrZero = Field(
        0.0, description="Silence between a response and the next request. More than 0: one request at a time."
    )
    after_connect: DurationOrZero = Field(0.0, description="Silence after connecting, before the first request.")
    idle: DurationOrZero = Field(
        0.0,
        description="The connection is closed after so long without a request, and opened for the next one, which "
        'waits for it. `"0"`: never.',
    )
    coalesce: bool = Field(
        True,
        description="Waiting reads of different clients that are equal share one transaction. Reads of one client are "
        "sent one after the other.",
    )
    retries: Annotated[int, Field(ge=0)] = Field(
        0, description="How often a read is repeated that got no valid response. Writes are never repeated."
    )
    rest: DurationOrOffOrAuto = Field(
        None,
        description='The longest back-off of a unit that does not answer. `"auto"`: one minute, or nine time limits if '
        "longer.",
    )
    queue: Count = Field(
        64,
        description="Maximum number of waiting requests. When it is exceeded, the client with most of them, by "
        "connection, then by address, gets 06 for its newest.",
    )
    max_wait: LongerDuration = Field(2.0, description="A request that has waited longer is answered 06 and not sent.")
    wake: DurationOrZero = Field(
        0.0,
        description="For devices that sleep: after so long without a request to it, the first read of a unit is sent "
        'twice, the second time when its limit has passed. Default of its units. `"0"`: they do not sleep.',
    )
    transaction_id: Literal["checked", "zero"] = Field(
        "checked",
        description="`zero`: for a server that always answers with transaction identifier 0; such responses are taken "
        "too. It means one request at a time. After a time-out or a response too many, a new connection is opened for "
        "the next request.",
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
        return self.name or str(self.to[0])
