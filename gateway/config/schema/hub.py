"""The keys of the file that `fleet hub` reads: the sites of a fleet, and who asks whom."""

from typing import Annotated

from pydantic import Field, PlainValidator

from gateway.config.schema.table import Table
from gateway.config.values.address import Address
from gateway.config.values.fleet import parse_control, parse_hub_address, parse_plain_path, parse_site_lease
from gateway.config.values.key_types import ListOf, SiteName

_Sites = Annotated[tuple[SiteName, ...], ListOf]
_Lease = Annotated[str, PlainValidator(parse_site_lease)]
_Path = Annotated[str, PlainValidator(parse_plain_path)]
_HubAddress = Annotated[Address, PlainValidator(parse_hub_address)]


class Hub(Table):
    """The sites of a fleet, what each may do there, and the server through which they reach each other."""

    control: Annotated[tuple[str, ...], PlainValidator(parse_control)] = Field(
        description="The site that may ask all others, or a list of several."
    )
    sites: _Sites = Field(description="All other sites. They may be asked.")
    asks: dict[str, _Sites] = Field({}, description="Which of `sites` may ask which others.")
    leases: Annotated[tuple[_Lease, ...], ListOf] = Field(
        (), description="The leases of lines, each as in the config of its site: SITE.NAME."
    )
    leaf_nodes: _Sites = Field((), description="Those of `sites` that have a NATS server of their own.")
    address: _HubAddress | None = Field(
        None, description="The name or address by which sites reach the hub. Required with `leaf_nodes`."
    )
    listen: _HubAddress | None = Field(
        None, description="Where it listens. Default: on all addresses with a certificate, on this machine without."
    )
    certificate: _Path | None = Field(None, description="Its certificate for TLS, and its chain (PEM).")
    key: _Path | None = Field(None, description="The private key of the certificate (PEM).")
    ca: _Path | None = Field(
        None, description="At the sites: the certificate of the authority, if it is your own (PEM)."
    )
    store: _Path = Field("/var/lib/nats", description="The folder in which JetStream keeps its data.")
