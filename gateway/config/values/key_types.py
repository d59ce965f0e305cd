"""The kinds of value that keys have, as types that read what a user wrote and refuse the rest in plain words."""

from collections.abc import Callable
from functools import partial
from ipaddress import IPv4Network, IPv6Network
from typing import Annotated, Any, Literal

from pydantic import AfterValidator, Field, Strict

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
from gateway.config.values.duration import (
    parse_duration,
    parse_duration_or_auto,
    parse_duration_or_off_or_auto,
    parse_duration_or_zero,
    parse_duration_or_zero_or_auto,
    parse_rs485_delay,
    parse_size_or_zero,
    show_duration,
    show_size,
)
from gateway.config.values.files import (
    check_path,
    in_folder,
    parse_file,
    parse_include,
    parse_token_file,
    secret_in_folder,
)
from gateway.config.values.fleet import parse_servers
from gateway.config.values.kind import NUMBER, TRUTH, WORD, Kind, Schema, any_of, list_of, map_to, one_of, text
from gateway.config.values.names import parse_name, parse_python_class, parse_role
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
from gateway.config.values.port import VirtualPort, parse_format, parse_line_port
from gateway.config.values.profile_keys import parse_identity, parse_item, parse_limits, parse_wide
from gateway.config.values.ranges import parse_addresses, parse_ranges
from gateway.config.values.site import (
    Site,
    parse_lease_name,
    parse_networks,
    parse_networks_or_sites,
    parse_other_servers,
    parse_site,
)
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


def _is_off(value: object) -> str:
    return "false" if value is None else str(value)


_TIME = text(r"0|[0-9]+(\.[0-9]+)?\s*(ms|s|min|h|days?)")
_RANGE = any_of(NUMBER, text(r"[0-9]+(\s*-\s*[0-9]+)?"))
_RANGES = any_of(_RANGE, list_of(_RANGE))
_RANGE_IN_TEXT = text(r"[0-9A-Fa-fxX]+(\s*-\s*[0-9A-Fa-fxX]+)?")
_RANGES_IN_TEXT = any_of(_RANGE_IN_TEXT, list_of(_RANGE_IN_TEXT))
_ADDRESS = text(".+://.+")
_SECRETS = tuple({"type": "object", "required": [key], "properties": {key: WORD}} for key in ("file", "credential"))
_NETWORKS = 'list such as `["10.2.0.0/24"]`'


def _time(parse: Callable[[Any], Any], name: str = "duration", *, schema: Schema = _TIME) -> Kind:
    return Kind(name, schema, parse, lambda seconds: f'"{show_duration(seconds)}"')


Name = Annotated[str, Kind("text", WORD, parse_name)]
Role = Annotated[str, Kind("text", WORD, parse_role)]
PythonClass = Annotated[str, Kind('text such as `"clock:Clock"`', text("[^/]+:[^/]+"), parse_python_class)]
Duration = Annotated[float, _time(parse_duration)]
#: What a device needs to think. Fast ones need less than a millisecond.
AnswerDuration = Annotated[float, _time(partial(parse_duration, least=0.0))]
#: How often something is done, or how long somebody waits for his turn: a line carries no more than this.
LongerDuration = Annotated[float, _time(partial(parse_duration, least=0.01), "duration from 10 ms")]
#: A holder renews its lease several times in it, over a network.
LeaseDuration = Annotated[float, _time(partial(parse_duration, least=1.0), "duration from 1 s")]
LeaseName = Annotated[str, Kind("text", WORD, parse_lease_name)]
SiteName = Annotated[str, Kind("text", WORD, parse_site)]
#: Longer than any client needs between connecting and asking; zero for never.
IdleDuration = Annotated[float, _time(partial(parse_duration_or_zero, least=1.0), "duration from 1 s")]
DurationOrZero = Annotated[float, _time(partial(parse_duration_or_zero, least=0.001))]
#: How often a disk is written: seldom enough for flash, often enough that little is lost by a sudden end.
WriteDuration = Annotated[float, _time(partial(parse_duration, least=1.0, most=600.0), "duration from 1 s to 10 min")]
#: A trend has some slots at least.
TrendDuration = Annotated[float, _time(partial(parse_duration_or_zero, least=600.0), "duration from 10 min")]
_OR_AUTO = any_of(_TIME, one_of("auto"))
DurationOrAuto = Annotated[float | None, _time(parse_duration_or_auto, 'duration or `"auto"`', schema=_OR_AUTO)]
DurationOrZeroOrAuto = Annotated[
    float | None, _time(parse_duration_or_zero_or_auto, 'duration or `"auto"`', schema=_OR_AUTO)
]
DurationOrOffOrAuto = Annotated[
    float | None,
    _time(parse_duration_or_off_or_auto, 'duration, `"auto"` or `"off"`', schema=any_of(_TIME, one_of("auto", "off"))),
]
Rs485Delay = Annotated[tuple[int, int], Kind('list such as `["1 ms", "0 ms"]`', list_of(_TIME), parse_rs485_delay)]
Format = Annotated[CharacterFormat, Kind('text such as `"8E1"`', text("[78][NEOneo][12]"), parse_format)]
LinePort = Annotated[
    str | Address | VirtualPort,
    Kind('path, address or `"pty:NAME"`', text("/.*|.+://.+|pty:.+"), parse_line_port),
]
SocketPath = Annotated[
    str, Field(min_length=1), AfterValidator(check_path), AfterValidator(in_folder), Kind("path", WORD)
]
Include = Annotated[tuple[str, ...], Kind('list such as `["conf.d/*.toml"]`', list_of(WORD), parse_include)]
Unit0 = Annotated[
    Literal["refuse", "broadcast"] | int,
    Kind(
        '`"refuse"`, `"broadcast"` or a unit', any_of(one_of("refuse", "broadcast"), NUMBER), parse_unit0, '"{}"'.format
    ),
]
ServedUnits = Annotated[
    tuple[int, ...] | Literal["all"], Kind('units or `"all"`', any_of(one_of("all"), _RANGES), parse_served_units)
]
UnitsOrNone = Annotated[
    tuple[int, ...], Kind('units or `"none"`', any_of(one_of("none"), _RANGES), parse_units_or_none)
]
OwnUnit = Annotated[int, AfterValidator(check_own_unit)]
UnitsFrom0 = Annotated[tuple[int, ...], Kind("units", _RANGES, partial(parse_units, first=0))]
UnitsOrAll = Annotated[
    tuple[int, ...] | Literal["all"],
    Kind('units or `"all"`', any_of(one_of("all"), _RANGES), parse_units_or_all, '"{}"'.format),
]
Ranges = Annotated[tuple[Range, ...], Kind("addresses", _RANGES, parse_ranges)]
RangesOfRow = Annotated[tuple[Range, ...], Kind("addresses", _RANGES_IN_TEXT, parse_addresses)]
Item = Annotated[int, Kind("value", any_of(NUMBER, TRUTH), parse_item)]
Limits = Annotated[dict[int, int], Kind("table such as `{ 3 = 99 }`", map_to(NUMBER), parse_limits)]
PointName = Annotated[str, Kind("text", WORD, parse_point_name)]
PointAddresses = Annotated[Range, Kind("address or range", _RANGE, parse_point_addresses)]
PointLabels = Annotated[dict[int, str], Kind('table such as `{ 0 = "off" }`', map_to(WORD), parse_labels)]
PointInvalid = Annotated[
    tuple[float, ...],
    Kind("number, or list of numbers", any_of({"type": "number"}, list_of({"type": "number"})), parse_invalid),
]
PointBits = Annotated[Range, Kind('range such as `"4-6"`', _RANGE, parse_bits)]
Wide = Annotated[
    dict[Area, tuple[Range, ...]],
    Kind(
        'table such as `{ holding = "5000-5999" }`, or `"all"`',
        any_of(one_of("all"), map_to(any_of(one_of("all"), _RANGES))),
        parse_wide,
    ),
]
KindIdentity = Annotated[Identity, Kind('table such as `{ fc43 = "Model" }`', {"type": "object"}, parse_identity)]
_WRITTEN = {"no": "false", "yes": "true", "only": '"only"'}
PointWriting = Annotated[
    Writing,
    Kind('`true`, `false` or `"only"`', any_of(TRUTH, one_of("only")), parse_writing, _WRITTEN.__getitem__),
]
MapPlace = Annotated[int | str, Kind("address, or name of a point", any_of(NUMBER, WORD), parse_map_place)]
WhenStale = Annotated[
    virtual.WhenStale,
    Kind(
        '`"exception"`, `"hold"` or a number',
        any_of(one_of("exception", "hold"), NUMBER),
        parse_when_stale,
        '"{}"'.format,
    ),
]
Networks = Annotated[tuple[IPv4Network | IPv6Network, ...], Kind(_NETWORKS, list_of(WORD), parse_networks)]
NetworksOrSites = Annotated[
    tuple[IPv4Network | IPv6Network | Site, ...], Kind(_NETWORKS, list_of(WORD), parse_networks_or_sites)
]
ListenAddress = Annotated[
    Address,
    Kind("address", _ADDRESS, partial(parse_address, schemes=("tcp", "tls", "rtu+tcp", "ascii+tcp", "udp"))),
]
OtherServers = Annotated[
    tuple[Address | Site, ...],
    Kind("address, or several", any_of(_ADDRESS, list_of(_ADDRESS)), parse_other_servers),
]
NatsServers = Annotated[
    tuple[Address, ...], Kind('list such as `["nats://127.0.0.1:4222"]`', list_of(_ADDRESS), parse_servers)
]
CredentialFile = Annotated[
    SecretFile,
    Kind("path or `{ credential = ... }`", any_of(WORD, *_SECRETS), parse_file),
    AfterValidator(secret_in_folder),
]
TokenFile = Annotated[
    str,
    Kind('table such as `{ file = "metrics.token" }`', any_of(*_SECRETS), parse_token_file),
    AfterValidator(in_folder),
]
BrokerAddress = Annotated[Broker, Kind("address", _ADDRESS, parse_broker)]
PasswordFile = Annotated[
    SecretFile,
    Kind("`{ file = ... }` or `{ credential = ... }`", any_of(*_SECRETS), parse_password),
    AfterValidator(secret_in_folder),
]
HomeAssistant = Annotated[
    str | None,
    Kind(
        f'`true`, `false` or a prefix such as `"{HOME_ASSISTANT}"`', any_of(TRUTH, WORD), parse_home_assistant, _is_off
    ),
]
TopicPrefix = Annotated[str, Kind("text", WORD, parse_prefix, '"{}"'.format)]
SparkplugNames = Annotated[
    Sparkplug | None,
    Kind(
        '`false` or table such as `{ group = "plant-2" }`',
        any_of(one_of(False), {"required": ["group"], **map_to(WORD)}),
        parse_sparkplug,
        _is_off,
    ),
]
WebAddress = Annotated[Address, Kind("address", _ADDRESS, partial(parse_address, schemes=("http", "https")))]
Size = Annotated[
    int,
    Kind(
        'size such as `"4 MiB"`',
        text(r"0|[0-9]+(\.[0-9]+)?\s*(KiB|MiB|GiB)"),
        parse_size_or_zero,
        lambda size: f'"{show_size(size)}"',
    ),
]
#: A TOML list; what stands in it stays as strict as it is.
ListOf = Strict(False)
