"""The keys of `[[listen]]`."""

from typing import Annotated, Literal

from pydantic import Field

from gateway.config.schema.table import Count, Table
from gateway.config.values.key_types import CredentialFile, IdleDuration, ListenAddress, Name, SiteName, Unit0


class Listen(Table):
    """An address where clients connect."""

    name: Name | None = Field(None, description="Its name in logs and in `[[access]]`. Default: the address.")
    bind: ListenAddress = Field(
        description="Protocol, host and port: `tcp://`, `tls://` ([Modbus/TCP Security](certificates.md)), "
        "`rtu+tcp://`, `ascii+tcp://` or `udp://`. Default port: 502, with `tls://` 802; none for RTU and ASCII over "
        "TCP. Port 0 uses a free one. "
        "`0.0.0.0` is every IPv4 address. `[::]` is every address, except IPv4 if another listener has an IPv4 address "
        "on the same port.",
    )
    clients: Count = Field(
        32,
        description="Maximum number of connections; with `udp://` of clients. When it is reached, a new client "
        "replaces one without a request in progress, in [this order](clients-and-rights.md#when-a-listener-is-full).",
    )
    reserve: Annotated[int, Field(ge=0)] = Field(
        0,
        description="How many of `clients` are reserved for addresses that get rights by the `from` of an `[[access]]` "
        "row, with `tls://` for clients that get rights by their role; without `[[access]]`, for local clients.",
    )
    idle: IdleDuration = Field(
        600.0, description='Clients without a request for this time are disconnected (UDP: forgotten). `"0"`: never.'
    )
    in_flight: Count = Field(
        16,
        description="Requests in progress for each connection; at the limit the gateway stops reading. RTU and ASCII "
        "over TCP: one is in progress, and this many may wait. UDP: requests beyond the limit are answered 06.",
    )
    unit0: Unit0 = Field(
        "refuse",
        description='Requests to unit 0. `"refuse"`: answer 0A. A number: use that unit instead. `"broadcast"`: send '
        "a write once to every line that accepts broadcasts, and to the images, without a response (client tools "
        "report a time-out); answer a read with 01. With RTU and ASCII over TCP, unit 0 gets no response at all "
        "unless this is a number.",
    )
    on_failure: Literal["exception", "silent"] = Field(
        "exception",
        description="What a client gets instead of a device's response: exception 0A, 0B or 06, or nothing, as from a "
        "device that is switched off. Exceptions 01 to 03, and responses of units, are always sent. With RTU and ASCII "
        "over TCP, if one of several requests that were sent together gets no response, none of them does.",
    )

    line: Name | None = Field(
        None,
        description="Makes this a listener for one line: unit IDs are addresses on that line, regardless of "
        "`as`, and nothing else can be reached. If the line has no `devices`, 1-247 are passed through. "
        "`unit0`, and `[[access]]` rows that name this listener, use these addresses too.",
    )
    upstream: Name | None = Field(
        None,
        description="Makes this a listener for one upstream: clients use the unit IDs of that server, 0-255, "
        "regardless of `as`, and nothing else can be reached. Units that its `units` do not name are passed through. "
        "Unit 0 is a unit of the server, with a response. `[[access]]` rows that name this listener use these unit "
        "IDs too.",
    )
    site: SiteName | None = Field(
        None,
        description="Makes this a listener for the units of another site, as `upstream` does for a server. It needs "
        '[`[fleet]`](fleet.md), and no `[[upstream]]`; one with `to = "fleet://SITE"` gives it a `timeout`, a '
        "`profile`, and names of units.",
    )
    certificate: CredentialFile | None = Field(
        None, description="With `tls://`: the file with the certificate and its chain (PEM)."
    )
    key: CredentialFile | None = Field(
        None, description="With `tls://`: the file with the private key (PEM); only its owner and group may read it."
    )
    clients_ca: CredentialFile | None = Field(
        None,
        description="With `tls://`: the file with the certificates of the authorities of clients (PEM).",
    )
    crl: CredentialFile | None = Field(
        None,
        description="With `tls://`: the file with the revocation list of each of these authorities (PEM). A list that "
        "has expired refuses every client.",
    )

    @property
    def label(self) -> str:
        """Give its name, or its default name."""
        return self.name or str(self.bind)
