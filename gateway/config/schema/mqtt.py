"""The keys of `[mqtt]`."""

from typing import Annotated

from pydantic import Field

from gateway.config.schema.table import Table
from gateway.config.values.broker import PREFIX
from gateway.config.values.key_types import (
    BrokerAddress,
    CredentialFile,
    HomeAssistant,
    ListOf,
    LongerDuration,
    Name,
    PasswordFile,
    Size,
    SparkplugNames,
    TopicPrefix,
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
