"""The kinds of value that keys have, as types that read what a user wrote and refuse the rest in plain words."""

import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import partial
from ipaddress import IPv4Network, IPv6Network, ip_interface, ip_network
from typing import Annotated, Any, Final, Literal

from pydantic import AfterValidator, Field, PlainValidator, Strict

from gateway.config.address import Address, parse_address
from gateway.config.broker import (
    HOME_ASSISTANT,
    Broker,
    Sparkplug,
    parse_broker,
    parse_home_assistant,
    parse_password,
    parse_sparkplug,
)
from gateway.config.character_format import parse_format
from gateway.config.duration import (
    parse_duration,
    parse_duration_or_auto,
    parse_duration_or_off_or_auto,
    parse_duration_or_zero,
    parse_duration_or_zero_or_auto,
    show_duration,
)
from gateway.config.fleet import SITE_RULE, Site, is_site, parse_other_server, parse_servers
from gateway.config.problem import NotText, WrongValue
from gateway.config.ranges import parse_ranges
from gateway.config.size import parse_size_or_zero, show_size
from gateway.config.unitset import CLIENT_UNITS, NO_CLIENT_UNIT, parse_client_units, parse_units
from gateway.modbus.codes import Area
from gateway.profiles.point import Writing
from gateway.profiles.profile import Range
from gateway.timing.characters import CharacterFormat
from gateway.tls.certificate import LONGEST_ROLE
from gateway.tls.secret_file import SecretFile

#: What is spoken behind a device server, by the scheme of its address. A line's port is one of these, or a path.
DEVICE_SERVER_MODES: Final[Mapping[str, Literal["rtu", "ascii"]]] = {"rtu+tcp": "rtu", "ascii+tcp": "ascii"}

_LONGEST_NAME: Final = 64
_IPV4_MAPPED: Final = IPv6Network("::ffff:0:0/96")
#: A file in the folder of systemd's credentials, and nowhere else.
_CREDENTIAL = re.compile(r"(?!\.)[A-Za-z0-9._-]{1,64}")
_FUNCTION = re.compile(r"[0-9]{1,9}")
_WHOLE_NUMBER = re.compile(r"-?[0-9]{1,20}")
#: With a star, which stands for a number.
_POINT_NAME = re.compile(r"[^\W\d_][\w.*-]*")


@dataclass(frozen=True, slots=True)
class Kind:
    """How the documentation calls a kind of value, and how it shows one."""

    name: str
    show: Callable[[Any], str] = str


def parse_name(value: object) -> str:
    """A name for people and logs.

    Raises:
        WrongValue: it would not look like one there.
    """
    if not isinstance(value, str):
        raise NotText
    if not value or len(value) > _LONGEST_NAME or not value.isprintable() or value != value.strip():
        raise WrongValue(f"must have 1 to {_LONGEST_NAME} visible characters, and no space around them")
    return value


def parse_lease_name(value: object) -> str:
    """The name of a lease, which is a key of a bucket.

    Raises:
        WrongValue: it cannot be one.
    """
    if not isinstance(value, str):
        raise NotText
    if not all(map(is_site, value.split("."))):
        raise WrongValue(f'"{value}" is not the name of a lease', f"{SITE_RULE} between two dots")
    return value


def parse_role(value: object) -> str:
    """A role in a certificate, or "" for none.

    Raises:
        WrongValue: no certificate has such a role.
    """
    if not isinstance(value, str):
        raise NotText
    if len(value) > LONGEST_ROLE or not value.isprintable():
        raise WrongValue(f"must have at most {LONGEST_ROLE} visible characters")
    return value


def parse_port(value: object) -> str | Address:
    """A line's port: the path of a serial device, or the address of a device server.

    Raises:
        WrongValue: it is neither.
    """
    if not isinstance(value, str):
        raise NotText
    if "://" in value:
        return parse_address(value, tuple(DEVICE_SERVER_MODES))
    if not value.startswith("/"):
        is_of_windows = re.fullmatch(r"COM\d+", value, re.IGNORECASE) is not None
        remedy = (
            "modbus-gateway ports lists those of this machine" if is_of_windows else f'did you mean "/dev/{value}"?'
        )
        raise WrongValue(f'"{value}" is not an absolute path', remedy)
    return check_path(value)


def check_path(value: str) -> str:
    """A path that the system takes, and a log can show.

    Raises:
        WrongValue: it has characters that cannot be seen, such as the NUL at which the system would end it.
    """
    if not value.isprintable():
        raise WrongValue("has characters that cannot be seen")
    return value


def parse_token_file(value: object) -> str:
    """The file that holds a token.

    Raises:
        WrongValue: `value` names no file.
    """
    match value:
        case {"file": str(path), **others} if path and not others:
            return check_path(path)
    raise WrongValue("names no file", 'write { file = "/etc/modbus-gateway/metrics.token" }')


def parse_file(value: object) -> SecretFile:
    """A path, or the name of a credential that systemd hands to the service.

    Raises:
        WrongValue: `value` is neither.
    """
    match value:
        case str(path) if path:
            return SecretFile(check_path(path))
        case {"credential": str(name), **others} if _CREDENTIAL.fullmatch(name) and not others:
            return SecretFile(name, is_credential=True)
    raise WrongValue("names no file", 'write "/etc/modbus-gateway/server.key", or { credential = "server.key" }')


def parse_unit0(value: object) -> Literal["refuse", "broadcast"] | int:
    """What becomes of requests to unit 0.

    Raises:
        WrongValue: nothing that is known.
    """
    if value == "refuse":
        return "refuse"
    if value == "broadcast":
        return "broadcast"
    if isinstance(value, int) and not isinstance(value, bool) and value in CLIENT_UNITS:
        return value
    raise WrongValue('must be "refuse", "broadcast" or a unit, 1-247 or 255')


def check_client_unit(value: int) -> int:
    """A unit that clients use.

    Raises:
        WrongValue: none can have this number.
    """
    if value not in CLIENT_UNITS:
        raise WrongValue(f"{value} is {NO_CLIENT_UNIT}")
    return value


def parse_item(value: object) -> int:
    """What a register or a coil holds at first: 0 to 65535, or true and false.

    Raises:
        WrongValue: it does not fit into a register.
    """
    if isinstance(value, int) and 0 <= value <= 0xFFFF:
        return int(value)
    raise WrongValue("must be 0 to 65535, or for coils true or false")


def parse_limits(value: object) -> dict[int, int]:
    """Most items by function, as in `{ 3 = 99 }`.

    Raises:
        WrongValue: a key is no function, one is there twice, or a value is no quantity.
    """
    if not isinstance(value, dict):
        raise WrongValue("must be a table", "write it as { 3 = 99 }: at most 99 items of function 3")
    limits: dict[int, int] = {}
    for text, most in value.items():
        function = _function_number(text)
        if function in limits:
            raise WrongValue(f"function {function} is there twice")
        limits[function] = _quantity(text, most)
    return limits


def parse_labels(value: object) -> dict[int, str]:
    """What numbers mean, as in `{ 0 = "off", 1 = "running" }`.

    Raises:
        WrongValue: a key is no whole number or is there twice, or a label is no text or is there twice.
    """
    if not isinstance(value, dict):
        raise WrongValue("must be a table", 'write it as { 0 = "off", 1 = "running" }')
    labels: dict[int, str] = {}
    for text, label in value.items():
        if not _WHOLE_NUMBER.fullmatch(text):
            raise WrongValue(f'"{text}" is no whole number', 'labels are for numbers: { 0 = "off", 1 = "running" }')
        if not isinstance(label, str) or not label.strip():
            raise WrongValue(f"the label of {text} must be text", f'write {text} = "running"')
        if int(text) in labels:
            raise WrongValue(f"{int(text)} is there twice")
        if label in labels.values():
            raise WrongValue(f'"{label}" is there twice')
        labels[int(text)] = label
    return labels


def parse_point_name(value: object) -> str:
    """The name of a point, which is typed behind a command and becomes a part of topics.

    Raises:
        WrongValue: it is none, or the name of an area.
    """
    if not isinstance(value, str):
        raise NotText
    if not _POINT_NAME.fullmatch(value) or len(value) > _LONGEST_NAME:
        what = f'"{value}" is no name of a point'
        raise WrongValue(what, f"letters, digits, - _ and . are allowed, a letter first, at most {_LONGEST_NAME}")
    if value in set(Area):
        raise WrongValue(f'"{value}" is the name of an area', "choose another name")
    return value


def parse_point_addresses(value: object) -> Range:
    """Where a point is: an address, or first and last of several points.

    Raises:
        WrongValue: it is neither.
    """
    if isinstance(value, int) and not isinstance(value, bool):
        value = str(value)
    ranges = parse_ranges(value) if isinstance(value, str) else ()
    if len(ranges) != 1:
        raise WrongValue("is no address", 'write an address such as 16, or a range "1-99" for several points')
    return ranges[0]


def parse_writing(value: object) -> Writing:
    """Whether a point can be written.

    Raises:
        WrongValue: nothing that is known.
    """
    if isinstance(value, bool):
        return "yes" if value else "no"
    if value == "only":
        return "only"
    raise WrongValue('must be true, false or "only"')


def parse_networks(value: object) -> tuple[IPv4Network | IPv6Network, ...]:
    """Networks such as "10.2.0.0/24", or single addresses.

    Raises:
        WrongValue: one of them is none.
    """
    if not isinstance(value, list):
        raise WrongValue("must be a list", 'write it as ["10.2.0.0/24"]')
    return tuple(_network(text) for text in value)


def parse_networks_or_sites(value: object) -> tuple[IPv4Network | IPv6Network | Site, ...]:
    """Networks, single addresses, or the names of sites.

    Raises:
        WrongValue: one of them is none.
    """
    if not isinstance(value, list):
        raise WrongValue("must be a list", 'write it as ["10.2.0.0/24"]')
    return tuple(Site(each) if isinstance(each, str) and _looks_like_site(each) else _network(each) for each in value)


def parse_units_or_all(value: object) -> tuple[int, ...] | Literal["all"]:
    """A unit set, or "all".

    Raises:
        WrongValue: it is neither.
    """
    return "all" if value == "all" else parse_client_units(value)


def _looks_like_site(text: str) -> bool:
    """Whether it can be the name of a site. One of digits only is an address with its dots forgotten."""
    return is_site(text) and not text.isdecimal()


def _function_number(text: str) -> int:
    if _FUNCTION.fullmatch(text) and 1 <= int(text) <= 127:
        return int(text)
    raise WrongValue(f'"{text}" is not a valid function number', "functions are numbered 1 to 127")


def _quantity(function: str, most: object) -> int:
    if isinstance(most, int) and not isinstance(most, bool) and most >= 1:
        return most
    raise WrongValue(f"the limit of function {function} must be a whole number from 1")


def _network(text: object) -> IPv4Network | IPv6Network:
    if not isinstance(text, str):
        raise WrongValue(f"{text} is not a valid network", 'write it as "10.2.0.0/24"')
    try:
        interface = ip_interface(text)
    except ValueError as wrong:
        raise WrongValue(f'"{text}" is not a valid network', 'write it as "10.2.0.0/24" or "10.2.0.7"') from wrong
    network = interface.network
    if interface.ip != network.network_address:
        what = f'"{text}" is an address in the network {network}, and not that network'
        raise WrongValue(what, f'write "{network}" for all of it, or "{interface.ip}" for that address')
    return _plain_ipv4(network)


def _plain_ipv4(network: IPv4Network | IPv6Network) -> IPv4Network | IPv6Network:
    """IPv4 clients that come to an IPv6 listener are IPv4 clients."""
    if network.version == 6 and network.prefixlen >= _IPV4_MAPPED.prefixlen and network.subnet_of(_IPV4_MAPPED):
        return ip_network((int(network.network_address) & 0xFFFFFFFF, network.prefixlen - _IPV4_MAPPED.prefixlen))
    return network


def _in_quotes(seconds: float | None) -> str:
    return f'"{show_duration(seconds)}"'


def _size_in_quotes(size: int) -> str:
    return f'"{show_size(size)}"'


def _is_off(value: object) -> str:
    return "false" if value is None else str(value)


_DURATION = Kind("duration", _in_quotes)
_DURATION_OR_AUTO = Kind('duration or `"auto"`', _in_quotes)
_UNITS = Kind("units")

Name = Annotated[str, PlainValidator(parse_name), Kind("text")]
Role = Annotated[str, PlainValidator(parse_role), Kind("text")]
Duration = Annotated[float, PlainValidator(parse_duration), _DURATION]
#: What a device needs to think. Fast ones need less than a millisecond.
AnswerDuration = Annotated[float, PlainValidator(partial(parse_duration, least=0.0)), _DURATION]
#: How often something is done, or how long somebody waits for his turn: a line carries no more than this.
LongerDuration = Annotated[
    float, PlainValidator(partial(parse_duration, least=0.01)), Kind("duration from 10 ms", _in_quotes)
]
#: A holder renews its lease several times in it, over a network.
LeaseDuration = Annotated[
    float, PlainValidator(partial(parse_duration, least=1.0)), Kind("duration from 1 s", _in_quotes)
]
LeaseName = Annotated[str, PlainValidator(parse_lease_name), Kind("text")]
#: Longer than any client needs between connecting and asking; zero for never.
IdleDuration = Annotated[
    float, PlainValidator(partial(parse_duration_or_zero, least=1.0)), Kind("duration from 1 s", _in_quotes)
]
DurationOrAuto = Annotated[float | None, PlainValidator(parse_duration_or_auto), _DURATION_OR_AUTO]
DurationOrOffOrAuto = Annotated[
    float | None, PlainValidator(parse_duration_or_off_or_auto), Kind('duration, `"auto"` or `"off"`', _in_quotes)
]
DurationOrZeroOrAuto = Annotated[float | None, PlainValidator(parse_duration_or_zero_or_auto), _DURATION_OR_AUTO]
Format = Annotated[CharacterFormat, PlainValidator(parse_format), Kind('text such as `"8E1"`')]
SerialPort = Annotated[str | Address, PlainValidator(parse_port), Kind("path or address")]
SocketPath = Annotated[str, Field(min_length=1), AfterValidator(check_path), Kind("path")]
Unit0 = Annotated[
    Literal["refuse", "broadcast"] | int,
    PlainValidator(parse_unit0),
    Kind('`"refuse"`, `"broadcast"` or a unit', '"{}"'.format),
]
Units = Annotated[tuple[int, ...], PlainValidator(parse_units), _UNITS]
ClientUnit = Annotated[int, AfterValidator(check_client_unit)]
ClientUnits = Annotated[tuple[int, ...], PlainValidator(parse_client_units), _UNITS]
WireUnits = Annotated[tuple[int, ...], PlainValidator(partial(parse_units, first=0)), _UNITS]
UpstreamUnits = Annotated[tuple[int, ...], PlainValidator(partial(parse_units, first=0, last=255)), _UNITS]
UnitsOrAll = Annotated[
    tuple[int, ...] | Literal["all"], PlainValidator(parse_units_or_all), Kind('units or `"all"`', '"{}"'.format)
]
Ranges = Annotated[tuple[Range, ...], PlainValidator(parse_ranges), Kind("addresses")]
Item = Annotated[int, PlainValidator(parse_item), Kind("value")]
Limits = Annotated[dict[int, int], PlainValidator(parse_limits), Kind("table such as `{ 3 = 99 }`")]
PointName = Annotated[str, PlainValidator(parse_point_name), Kind("text")]
PointAddresses = Annotated[Range, PlainValidator(parse_point_addresses), Kind("address or range")]
PointLabels = Annotated[dict[int, str], PlainValidator(parse_labels), Kind('table such as `{ 0 = "off" }`')]
PointWriting = Annotated[
    Writing,
    PlainValidator(parse_writing),
    Kind('`true`, `false` or `"only"`', {"no": "false", "yes": "true", "only": '"only"'}.__getitem__),
]
Networks = Annotated[
    tuple[IPv4Network | IPv6Network, ...], PlainValidator(parse_networks), Kind('list such as `["10.2.0.0/24"]`')
]
NetworksOrSites = Annotated[
    tuple[IPv4Network | IPv6Network | Site, ...],
    PlainValidator(parse_networks_or_sites),
    Kind('list such as `["10.2.0.0/24"]`'),
]
ListenAddress = Annotated[
    Address,
    PlainValidator(partial(parse_address, schemes=("tcp", "tls", "rtu+tcp", "ascii+tcp", "udp"))),
    Kind("address"),
]
OtherServer = Annotated[Address | Site, PlainValidator(parse_other_server), Kind("address")]
NatsServers = Annotated[
    tuple[Address, ...], PlainValidator(parse_servers), Kind('list such as `["nats://127.0.0.1:4222"]`')
]
CredentialFile = Annotated[SecretFile, PlainValidator(parse_file), Kind("path or `{ credential = ... }`")]
TokenFile = Annotated[str, PlainValidator(parse_token_file), Kind('table such as `{ file = "metrics.token" }`')]
BrokerAddress = Annotated[Broker, PlainValidator(parse_broker), Kind("address")]
PasswordFile = Annotated[SecretFile, PlainValidator(parse_password), Kind("`{ file = ... }` or `{ credential = ... }`")]
HomeAssistant = Annotated[
    str | None,
    PlainValidator(parse_home_assistant),
    Kind(f'`true`, `false` or a prefix such as `"{HOME_ASSISTANT}"`', _is_off),
]
SparkplugNames = Annotated[
    Sparkplug | None, PlainValidator(parse_sparkplug), Kind('`false` or table such as `{ group = "plant-2" }`', _is_off)
]
WebAddress = Annotated[Address, PlainValidator(partial(parse_address, schemes=("http", "https"))), Kind("address")]
Size = Annotated[int, PlainValidator(parse_size_or_zero), Kind('size such as `"4 MiB"`', _size_in_quotes)]

#: A TOML list; what stands in it stays as strict as it is.
ListOf = Strict(False)
