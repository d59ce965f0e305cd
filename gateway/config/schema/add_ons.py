"""The keys of `[web]`, `[mqtt]` and `[fleet]`."""

from typing import Annotated, Literal

from pydantic import Field

from gateway.config.schema.table import Table
from gateway.config.values.broker import PREFIX
from gateway.config.values.key_types import (
    BrokerAddress,
    CredentialFile,
    HomeAssistant,
    LeaseDuration,
    ListOf,
    LongerDuration,
    Name,
    NatsServers,
    Networks,
    PasswordFile,
    Size,
    SocketPath,
    SparkplugNames,
    TokenFile,
    TopicPrefix,
    TrendDuration,
    WebAddress,
    WriteDuration,
)


class Publish(Table):
    """Points that are published. For each point, the first row that matches it and its device applies."""

    device: Name = Field(description="The names of devices, images or mirrors; `*` stands for any characters.")
    points: Annotated[tuple[Name, ...], ListOf] = Field(
        ("*",),
        description="The names of points, in the same way; those behind a `!` are left out: "
        '`["!comms-*"]` is all others. Default: all that can be read.',
    )
    every: LongerDuration = Field(description="Time from one read to the next.")
    on_change: Annotated[float, Field(ge=0, allow_inf_nan=False)] | None = Field(
        None,
        description="A value is published when it differs by at least this from the last one published. Default: when "
        "it differs at all.",
    )
    at_least: LongerDuration | None = Field(
        None, description="An unchanged value is published again after this time. Default: never."
    )


class Mqtt(Table):
    """Values for a broker, and writes from there; without this table there are none. See [plant](plant.md)."""

    broker: BrokerAddress = Field(
        description="Its address: `mqtt://`, `mqtts://`, or for WebSockets `ws://` and `wss://`, with a path if it is "
        "not `/mqtt`. Default ports: 1883, 8883, 80, 443."
    )
    user: Name | None = Field(None, description="The name with which the gateway logs in.")
    password: PasswordFile | None = Field(
        None, description="The file with its password; only its owner and group may read it."
    )
    publish: Annotated[tuple[Publish, ...], ListOf] = Field(description="What is published.")
    write: bool = Field(False, description="Whether points with `write` = true can be written through the broker.")
    prefix: TopicPrefix = Field(
        PREFIX, description="The first level of all topics, or the first ones with `/` between them."
    )
    keep: Size = Field(
        0,
        description="How much disk the values may take that could not be published while the broker was away, from "
        "64 KiB to 1 GiB. They are sent when it is back; if there are more, the oldest are given up. See "
        "[plant](plant.md#while-the-broker-is-away).",
    )
    keep_every: WriteDuration = Field(
        10.0, description="With `keep`: how often they are written to disk. A sudden end loses no more than this."
    )
    home_assistant: HomeAssistant = Field(
        None, description="Whether Home Assistant is told what there is, so that it shows all devices by itself."
    )
    sparkplug: SparkplugNames = Field(
        None,
        description="Sparkplug B instead of plain JSON. `node` is the name of the gateway in the group (default: "
        "`site`); with `primary_host` it waits until that host application is online.",
    )
    ca: CredentialFile | None = Field(
        None,
        description="With `mqtts://` and `wss://`: the file with the certificates of the authorities of the broker "
        "(PEM). Default: those that the system trusts.",
    )
    certificate: CredentialFile | None = Field(
        None, description="The same: the file with the certificate that the gateway shows, and its chain (PEM)."
    )
    key: CredentialFile | None = Field(
        None,
        description="The same: the file with its private key (PEM); only its owner and group may read it.",
    )
    server_name: Name | None = Field(
        None,
        description="The same: the name or address in the certificate of the broker. Default: the host in `broker`.",
    )


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


class Web(Table):
    """The web page, the HTTP API, and metrics for Prometheus; without this table there are none. See [web](web.md)."""

    bind: WebAddress = Field(
        description="Where to listen: `http://` or `https://`. Clients on this machine read without a password; if "
        "other machines can connect, `users`, `token` or `proxy` must be given."
    )
    certificate: CredentialFile | None = Field(
        None, description="With `https://`: the file with the certificate and its chain (PEM)."
    )
    key: CredentialFile | None = Field(
        None,
        description="With `https://`: the file with the private key (PEM); only its owner and group may read it.",
    )
    users: SocketPath | None = Field(
        None,
        description="The file with the users, and with programs that have a token and a role, made by "
        "`modbus-gateway user`. Changes apply within 5 s.",
    )
    proxy: Networks | None = Field(
        None,
        description="Addresses of reverse proxies that ask for the password: the header `X-Forwarded-User` of their "
        "requests names the user, whose role is that in `users`, otherwise viewer.",
    )
    hosts: Annotated[tuple[Name, ...], ListOf] = Field(
        (), description="Names by which it may be called, beside its addresses and `localhost`."
    )
    token: TokenFile | None = Field(
        None,
        description="The file with the token that programs send for `/metrics` and reads of the API "
        "(`Authorization: Bearer ...`). If it is given, `/metrics` needs it or a login also from this machine.",
    )
    write: bool = Field(
        False,
        description="Whether users and programs with the role `operator` may write coils and registers through it.",
    )
    values: TrendDuration = Field(
        24 * 3600.0,
        description="How long values of points are kept for trends, in `trends.sqlite` in the state directory: up to "
        '`"24 h"` in slots of 1 min, up to `"7 days"` in slots of 10 min; `"0"` = not. At most 32 MiB: then the oldest '
        "are dropped.",
    )
    history: bool = Field(
        True,
        description="Whether the history of units (one day) and lines (one week) is kept in `history.sqlite` in the "
        "state directory. If not, it is lost at a restart, and so are trends.",
    )
