"""The kinds of value that keys have, as types that read what a user wrote and refuse the rest in plain words."""

from functools import partial
from ipaddress import IPv4Network, IPv6Network
from typing import Annotated, Literal

from pydantic import AfterValidator, Field, PlainValidator, Strict

from gateway.config.values.address import Address, parse_address
from gateway.config.values.broker import (
    HOME_ASSISTANT,
    Broker,
    Sparkplug,
    parse_broker,
    parse_home_assistant,
    parse_password,
    parse_prefix,
    parse_sparkplug,
)
from gateway.config.values.character_format import parse_format
from gateway.config.values.duration import (
    parse_duration,
    parse_duration_or_auto,
    parse_duration_or_off_or_auto,
    parse_duration_or_zero,
    parse_duration_or_zero_or_auto,
    show_duration,
)
from gateway.config.values.files import check_path, in_folder, parse_file, parse_token_file, secret_in_folder
from gateway.config.values.fleet import parse_servers
from gateway.config.values.kind import NUMBER, TRUTH, WORD, Kind, any_of, list_of, map_to, one_of, text
from gateway.config.values.names import parse_name, parse_python_class, parse_role
from gateway.config.values.networks import parse_networks, parse_networks_or_sites
from gateway.config.values.point_keys import (
    parse_bits,
    parse_invalid,
    parse_labels,
    parse_map_place,
    parse_point_addresses,
    parse_point_name,
    parse_when_stale,
    parse_writing,
)
from gateway.config.values.port import VirtualPort, parse_line_port
from gateway.config.values.profile_keys import parse_identity, parse_item, parse_limits, parse_wide
from gateway.config.values.ranges import parse_addresses, parse_ranges
from gateway.config.values.site import Site, parse_lease_name, parse_other_servers, parse_site
from gateway.config.values.size import parse_size_or_zero, show_size
from gateway.config.values.unitset import (
    check_own_unit,
    parse_served_units,
    parse_unit0,
    parse_units,
    parse_units_or_all,
    parse_units_or_none,
)
from gateway.images.virtual import settings as virtual
from gateway.modbus.codes import Area
from gateway.profiles.identity import Identity
from gateway.profiles.point import Writing
from gateway.profiles.profile import Range
from gateway.timing.characters import CharacterFormat
from gateway.tls.settings import SecretFile


def _in_quotes(seconds: float | None) -> str:
    return f'"{show_duration(seconds)}"'


def _size_in_quotes(size: int) -> str:
    return f'"{show_size(size)}"'


def _is_off(value: object) -> str:
    return "false" if value is None else str(value)


_TIME = text(r"0|[0-9]+(\.[0-9]+)?\s*(ms|s|min|h|days?)")
_RANGE = any_of(NUMBER, text(r"[0-9]+(\s*-\s*[0-9]+)?"))
_RANGES = any_of(_RANGE, list_of(_RANGE))
_RANGE_IN_TEXT = text(r"[0-9A-Fa-fxX]+(\s*-\s*[0-9A-Fa-fxX]+)?")
_RANGES_IN_TEXT = any_of(_RANGE_IN_TEXT, list_of(_RANGE_IN_TEXT))
_ADDRESS = text(".+://.+")
_SECRETS = tuple({"type": "object", "required": [key], "properties": {key: WORD}} for key in ("file", "credential"))

_DURATION = Kind("duration", _TIME, _in_quotes)
_DURATION_OR_AUTO = Kind('duration or `"auto"`', any_of(_TIME, one_of("auto")), _in_quotes)
_UNITS = Kind("units", _RANGES)
_NETWORKS = Kind('list such as `["10.2.0.0/24"]`', list_of(WORD))

Name = Annotated[str, PlainValidator(parse_name), Kind("text", WORD)]
Role = Annotated[str, PlainValidator(parse_role), Kind("text", WORD)]
PythonClass = Annotated[
    str, PlainValidator(parse_python_class), Kind('text such as `"clock:Clock"`', text("[^/]+:[^/]+"))
]
Duration = Annotated[float, PlainValidator(parse_duration), _DURATION]
#: What a device needs to think. Fast ones need less than a millisecond.
AnswerDuration = Annotated[float, PlainValidator(partial(parse_duration, least=0.0)), _DURATION]
#: How often something is done, or how long somebody waits for his turn: a line carries no more than this.
LongerDuration = Annotated[
    float, PlainValidator(partial(parse_duration, least=0.01)), Kind("duration from 10 ms", _TIME, _in_quotes)
]
#: A holder renews its lease several times in it, over a network.
LeaseDuration = Annotated[
    float, PlainValidator(partial(parse_duration, least=1.0)), Kind("duration from 1 s", _TIME, _in_quotes)
]
LeaseName = Annotated[str, PlainValidator(parse_lease_name), Kind("text", WORD)]
SiteName = Annotated[str, PlainValidator(parse_site), Kind("text", WORD)]
#: Longer than any client needs between connecting and asking; zero for never.
IdleDuration = Annotated[
    float, PlainValidator(partial(parse_duration_or_zero, least=1.0)), Kind("duration from 1 s", _TIME, _in_quotes)
]
DurationOrZero = Annotated[
    float, PlainValidator(partial(parse_duration_or_zero, least=0.001)), Kind("duration", _TIME, _in_quotes)
]
#: How often a disk is written: seldom enough for flash, often enough that little is lost by a sudden end.
WriteDuration = Annotated[
    float,
    PlainValidator(partial(parse_duration, least=1.0, most=600.0)),
    Kind("duration from 1 s to 10 min", _TIME, _in_quotes),
]
#: A trend has some slots at least.
TrendDuration = Annotated[
    float, PlainValidator(partial(parse_duration_or_zero, least=600.0)), Kind("duration from 10 min", _TIME, _in_quotes)
]
DurationOrAuto = Annotated[float | None, PlainValidator(parse_duration_or_auto), _DURATION_OR_AUTO]
DurationOrOffOrAuto = Annotated[
    float | None,
    PlainValidator(parse_duration_or_off_or_auto),
    Kind('duration, `"auto"` or `"off"`', any_of(_TIME, one_of("auto", "off")), _in_quotes),
]
DurationOrZeroOrAuto = Annotated[float | None, PlainValidator(parse_duration_or_zero_or_auto), _DURATION_OR_AUTO]
Format = Annotated[
    CharacterFormat, PlainValidator(parse_format), Kind('text such as `"8E1"`', text("[78][NEOneo][12]"))
]
LinePort = Annotated[
    str | Address | VirtualPort,
    PlainValidator(parse_line_port),
    Kind('path, address or `"pty:NAME"`', text("/.*|.+://.+|pty:.+")),
]
SocketPath = Annotated[
    str, Field(min_length=1), AfterValidator(check_path), AfterValidator(in_folder), Kind("path", WORD)
]
Unit0 = Annotated[
    Literal["refuse", "broadcast"] | int,
    PlainValidator(parse_unit0),
    Kind('`"refuse"`, `"broadcast"` or a unit', any_of(one_of("refuse", "broadcast"), NUMBER), '"{}"'.format),
]
Units = Annotated[tuple[int, ...], PlainValidator(parse_units), _UNITS]
ServedUnits = Annotated[
    tuple[int, ...] | Literal["all"],
    PlainValidator(parse_served_units),
    Kind('units or `"all"`', any_of(one_of("all"), _RANGES)),
]
UnitsOrNone = Annotated[
    tuple[int, ...],
    PlainValidator(parse_units_or_none),
    Kind('units or `"none"`', any_of(one_of("none"), _RANGES)),
]
OwnUnit = Annotated[int, AfterValidator(check_own_unit)]
UnitsFrom0 = Annotated[tuple[int, ...], PlainValidator(partial(parse_units, first=0)), _UNITS]
UnitsOrAll = Annotated[
    tuple[int, ...] | Literal["all"],
    PlainValidator(parse_units_or_all),
    Kind('units or `"all"`', any_of(one_of("all"), _RANGES), '"{}"'.format),
]
Ranges = Annotated[tuple[Range, ...], PlainValidator(parse_ranges), Kind("addresses", _RANGES)]
RangesOfRow = Annotated[
    tuple[Range, ...],
    PlainValidator(parse_addresses),
    Kind("addresses", _RANGES_IN_TEXT),
]
Item = Annotated[int, PlainValidator(parse_item), Kind("value", any_of(NUMBER, TRUTH))]
Limits = Annotated[dict[int, int], PlainValidator(parse_limits), Kind("table such as `{ 3 = 99 }`", map_to(NUMBER))]
PointName = Annotated[str, PlainValidator(parse_point_name), Kind("text", WORD)]
PointAddresses = Annotated[Range, PlainValidator(parse_point_addresses), Kind("address or range", _RANGE)]
PointLabels = Annotated[
    dict[int, str], PlainValidator(parse_labels), Kind('table such as `{ 0 = "off" }`', map_to(WORD))
]
PointInvalid = Annotated[
    tuple[float, ...],
    PlainValidator(parse_invalid),
    Kind("number, or list of numbers", any_of({"type": "number"}, list_of({"type": "number"}))),
]
PointBits = Annotated[Range, PlainValidator(parse_bits), Kind('range such as `"4-6"`', _RANGE)]
Wide = Annotated[
    dict[Area, tuple[Range, ...]],
    PlainValidator(parse_wide),
    Kind(
        'table such as `{ holding = "5000-5999" }`, or `"all"`',
        any_of(one_of("all"), map_to(any_of(one_of("all"), _RANGES))),
    ),
]
KindIdentity = Annotated[
    Identity,
    PlainValidator(parse_identity),
    Kind('table such as `{ fc43 = "Model" }`', {"type": "object"}),
]
PointWriting = Annotated[
    Writing,
    PlainValidator(parse_writing),
    Kind(
        '`true`, `false` or `"only"`',
        any_of(TRUTH, one_of("only")),
        {"no": "false", "yes": "true", "only": '"only"'}.__getitem__,
    ),
]
MapPlace = Annotated[
    int | str, PlainValidator(parse_map_place), Kind("address, or name of a point", any_of(NUMBER, WORD))
]
WhenStale = Annotated[
    virtual.WhenStale,
    PlainValidator(parse_when_stale),
    Kind('`"exception"`, `"hold"` or a number', any_of(one_of("exception", "hold"), NUMBER), '"{}"'.format),
]
Networks = Annotated[tuple[IPv4Network | IPv6Network, ...], PlainValidator(parse_networks), _NETWORKS]
NetworksOrSites = Annotated[
    tuple[IPv4Network | IPv6Network | Site, ...],
    PlainValidator(parse_networks_or_sites),
    _NETWORKS,
]
ListenAddress = Annotated[
    Address,
    PlainValidator(partial(parse_address, schemes=("tcp", "tls", "rtu+tcp", "ascii+tcp", "udp"))),
    Kind("address", _ADDRESS),
]
OtherServers = Annotated[
    tuple[Address | Site, ...],
    PlainValidator(parse_other_servers),
    Kind("address, or several", any_of(_ADDRESS, list_of(_ADDRESS))),
]
NatsServers = Annotated[
    tuple[Address, ...],
    PlainValidator(parse_servers),
    Kind('list such as `["nats://127.0.0.1:4222"]`', list_of(_ADDRESS)),
]
CredentialFile = Annotated[
    SecretFile,
    PlainValidator(parse_file),
    AfterValidator(secret_in_folder),
    Kind("path or `{ credential = ... }`", any_of(WORD, *_SECRETS)),
]
TokenFile = Annotated[
    str,
    PlainValidator(parse_token_file),
    AfterValidator(in_folder),
    Kind('table such as `{ file = "metrics.token" }`', any_of(*_SECRETS)),
]
BrokerAddress = Annotated[Broker, PlainValidator(parse_broker), Kind("address", _ADDRESS)]
PasswordFile = Annotated[
    SecretFile,
    PlainValidator(parse_password),
    AfterValidator(secret_in_folder),
    Kind("`{ file = ... }` or `{ credential = ... }`", any_of(*_SECRETS)),
]
HomeAssistant = Annotated[
    str | None,
    PlainValidator(parse_home_assistant),
    Kind(f'`true`, `false` or a prefix such as `"{HOME_ASSISTANT}"`', any_of(TRUTH, WORD), _is_off),
]
TopicPrefix = Annotated[str, PlainValidator(parse_prefix), Kind("text", WORD, '"{}"'.format)]
SparkplugNames = Annotated[
    Sparkplug | None,
    PlainValidator(parse_sparkplug),
    Kind(
        '`false` or table such as `{ group = "plant-2" }`',
        any_of(one_of(False), {"required": ["group"], **map_to(WORD)}),
        _is_off,
    ),
]
WebAddress = Annotated[
    Address, PlainValidator(partial(parse_address, schemes=("http", "https"))), Kind("address", _ADDRESS)
]
Size = Annotated[
    int,
    PlainValidator(parse_size_or_zero),
    Kind('size such as `"4 MiB"`', text(r"0|[0-9]+(\.[0-9]+)?\s*(KiB|MiB|GiB)"), _size_in_quotes),
]

#: A TOML list; what stands in it stays as strict as it is.
ListOf = Strict(False)
