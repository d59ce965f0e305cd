"""Parameters of operations, each with a description of what it must be."""

from dataclasses import dataclass
from typing import Annotated, Any, Final

from gateway.modbus.codes import Area
from gateway.operator.operations.parameters import Filled, InBody, OneOf, Within
from gateway.registers.datatypes import DATA_TYPES, SWAPS
from gateway.timing.history import LINE_SLOTS, STEP, UNIT_SLOTS
from gateway.trace.records import MOST_STORIES

#: How many hours of a history are kept.
MOST_HOURS_OF_A_LINE: Final = LINE_SLOTS * STEP // 3600
MOST_HOURS_OF_A_UNIT: Final = UNIT_SLOTS * STEP // 3600
#: The longest age of shared values of points, in seconds.
LONGEST_AGE: Final = 60
#: Records may be looked for this many seconds back: longer than any machine runs.
_LONGEST_LOOK_BACK: Final = 1e9

#: The severities of events, and the most that are kept.
LEVELS: Final = ("info", "warning", "error")
MOST_EVENTS: Final = 1000

#: A unit: the number that clients use, or its name.
UnitNamed = Annotated[int | str, Within(0, 255), "a number from 0 to 255, or a name"]
LineNamed = Annotated[str, "the name of a line"]
#: Whether records say what they mean.
WithPoints = Annotated[
    bool, "true or false: whether each record has the first `points` that it covers, and the number of `more_points`"
]
PointNamed = Annotated[str, "the name of a point"]


@dataclass(frozen=True, slots=True)
class OneUnit:
    """One `unit`."""

    unit: UnitNamed


@dataclass(frozen=True, slots=True)
class KnownOf:
    """The `unit` whose values are asked for; all devices without it."""

    unit: UnitNamed | None = None


#: A time in a trend.
_TimeNamed = Annotated[str | None, "a time such as 2026-05-01T08:00:00Z, or how long ago it is, such as 6 h"]


@dataclass(frozen=True, slots=True)
class TrendOfPoint:
    """The trend of a `point` of a `device`, from `since` up to `until`, in steps that are at least a slot.

    Without `since` it begins where it is kept from, and without `until` it goes up to now.
    """

    device: UnitNamed
    point: PointNamed
    since: _TimeNamed = None
    until: _TimeNamed = None
    step: Annotated[str | None, "a duration such as 10 min"] = None


@dataclass(frozen=True, slots=True)
class OneDevice:
    """One `device`."""

    device: UnitNamed


@dataclass(frozen=True, slots=True)
class OneRequest:
    """A request to `unit`: its `pdu` in hexadecimal.

    One of function 22 can be carried out as a read and a write `in_one_turn`, which no other write of the gateway comes
    between: by a device whose profile does not name 22, with this function, 06 or 16.
    """

    unit: UnitNamed
    pdu: Annotated[str, 'bytes in hexadecimal, such as "03 00 00 00 02"']
    in_one_turn: Annotated[int, OneOf((6, 16)), "6 or 16, the function that writes the register"] = 0


@dataclass(frozen=True, slots=True)
class ToExamine:
    """The `line`, server line or upstream to examine; all without it. Nothing is sent unless `ask` is set."""

    line: LineNamed | None = None
    ask: Annotated[bool, "true or false: whether requests may be sent"] = True


@dataclass(frozen=True, slots=True)
class Traced:
    """Records from number `after` on; or those of the last `since` seconds; or the last few.

    `line`, `unit`, `function`, `client` and `result` select among them. With `lines`, the answer includes the lines.
    """

    after: Annotated[int | None, "a number: that of the first record, as `next` in the answer before"] = None
    since: Annotated[
        float | None, Within(0, _LONGEST_LOOK_BACK), "a number of seconds, not below 0: records of that time before now"
    ] = None
    line: Annotated[str | None, "the name of a line"] = None
    unit: Annotated[int | str | None, "the number or name of a unit"] = None
    function: Annotated[int | None, "a function code"] = None
    client: Annotated[str | None, "a client, or its address"] = None
    result: Annotated[str | None, "ok, exception, failed (all others), or one of these, such as timeout"] = None
    lines: Annotated[bool, "true or false: whether the answer has the lines too"] = False
    points: WithPoints = False


@dataclass(frozen=True, slots=True)
class ToUnderstand:
    """A `request` to `unit` and the `response` to it, both as PDUs."""

    unit: UnitNamed
    request: Annotated[str, 'bytes in hexadecimal, such as "03 00 00 00 02"']
    response: Annotated[str, "bytes in hexadecimal; without them only what was written is told"] = ""


@dataclass(frozen=True, slots=True)
class ToList:
    """Events of the last `since` seconds from this `level` on, or the last `count`; or those that came `after` others.

    `line`, `unit` and `client` select among them.
    """

    since: Annotated[
        int | float | None,
        Within(0, _LONGEST_LOOK_BACK),
        "a number of seconds, not below 0: events of that time before now",
    ] = None
    level: Annotated[str, OneOf(LEVELS), f"one of {', '.join(LEVELS)}; the least severe"] = "info"
    line: Annotated[str | None, "the name of a line"] = None
    unit: Annotated[int | str | None, "the number or name of a unit"] = None
    client: Annotated[str | None, "a client, or its address"] = None
    count: Annotated[int | None, Within(1, MOST_EVENTS), f"1 to {MOST_EVENTS}: how many, the last ones"] = None
    after: Annotated[int | None, "a number: `next` of an earlier answer"] = None


@dataclass(frozen=True, slots=True)
class ToExplain:
    """The last `count` failed requests of `who`: a unit by number or name, a line, or a client by name or address.

    With a `line`, only those on it.
    """

    who: Annotated[str, 'a unit, or a client such as "10.2.0.7"']
    count: Annotated[int, Within(1, MOST_STORIES), f"1 to {MOST_STORIES}"] = 5
    line: Annotated[str | None, "the name of a line"] = None


@dataclass(frozen=True, slots=True)
class ToMeasure:
    """The `line` to read as fast as possible for `seconds`: all its units or one, `items` from `address` on.

    With `progress`, there is an answer each second.
    """

    line: LineNamed
    unit: UnitNamed | None = None
    seconds: Annotated[float, Within(0.001, 3600), "a number above 0, 3600 at most"] = 60.0
    items: Annotated[int, Within(1, 2000), "a number above 0, 2000 at most"] = 10
    address: Annotated[int | None, Within(0, 65535), "a number from 0 to 65535"] = None
    progress: Annotated[bool, "true or false: whether to tell each second how far it is"] = False


@dataclass(frozen=True, slots=True)
class ToScan:
    """The `line` to scan, for the `units` or all numbers; a response may take `limit_s` seconds.

    With `all_speeds`, it is scanned at all usual rates.
    """

    line: LineNamed
    units: Annotated[int | str | list[Any] | None, 'units such as "1-32"'] = None
    limit_s: Annotated[float, Within(0.001, 10), "more than 0 and at most 10 s"] = 0.3
    all_speeds: Annotated[bool, "true or false: whether to scan at all usual rates"] = False


@dataclass(frozen=True, slots=True)
class ToSupport:
    """A diagnostics bundle; without `trace` it has no values of units."""

    trace: Annotated[bool, "true or false: whether the last minutes of the trace are told"] = True


@dataclass(frozen=True, slots=True)
class OneLine:
    """The client line, server line or upstream of this `name`."""

    name: LineNamed


@dataclass(frozen=True, slots=True)
class PastOfLine:
    """The history of the line or upstream of this `name` in the last `hours`."""

    name: LineNamed
    hours: Annotated[
        int, Within(1, MOST_HOURS_OF_A_LINE), f"a whole number of hours from 1 to {MOST_HOURS_OF_A_LINE}"
    ] = 24


@dataclass(frozen=True, slots=True)
class PastOfUnit:
    """The history of a `unit` in the last `hours`."""

    unit: UnitNamed
    hours: Annotated[
        int, Within(1, MOST_HOURS_OF_A_UNIT), f"a whole number of hours from 1 to {MOST_HOURS_OF_A_UNIT}"
    ] = 24


@dataclass(frozen=True, slots=True)
class PointsToRead:
    """All points of a `unit`; values that were read at most `max_age` seconds ago are not read again."""

    unit: UnitNamed
    max_age: Annotated[int, Within(0, LONGEST_AGE), f"a whole number of seconds from 0 to {LONGEST_AGE}"] = 0


@dataclass(frozen=True, slots=True)
class PointToRead:
    """The point `name` of a `unit`."""

    unit: UnitNamed
    name: PointNamed


@dataclass(frozen=True, slots=True)
class Addresses:
    """The addresses of a `unit` from `start` to `end`, or one value at `start`, as `type` with `swap`."""

    unit: UnitNamed
    area: Area
    start: Annotated[int, Within(0, 65535), "an address from 0 to 65535"]
    end: Annotated[int | None, Within(0, 65535), "an address from 0 to 65535"] = None
    type: Annotated[str, OneOf(DATA_TYPES), f"one of {', '.join(DATA_TYPES)}; without it uint16, for bits bit"] = ""
    swap: Annotated[str, OneOf(SWAPS), f"one of {', '.join(SWAPS)}; without it none"] = "none"


#: A value to write: a number, a truth value, a label or text.
NewValue = float | str | bool


@dataclass(frozen=True, slots=True)
class NamedValue:
    """The new value of a point."""

    point: str
    value: NewValue


@dataclass(frozen=True, slots=True, kw_only=True)
class ValuesToWrite(Addresses):
    """New `values` from an address on, written by one request."""

    values: Annotated[list[NewValue], InBody(), Filled(), "a list with one value at least"]


@dataclass(frozen=True, slots=True)
class PointToWrite(PointToRead):
    """The new value of the point `name`, in a list of one."""

    values: Annotated[list[NewValue], InBody(), Filled(), "a list with one value"]


@dataclass(frozen=True, slots=True)
class PointsToWrite:
    """New `values` of points that lie side by side, written by one request."""

    unit: UnitNamed
    values: Annotated[
        list[NamedValue], InBody(), Filled(), 'a list in which each value is {"point": NAME, "value": VALUE}'
    ]


@dataclass(frozen=True, slots=True)
class TextToCheck:
    """A `text` that might become the config."""

    text: Annotated[str, InBody(), "a config as text, of at most 1 MiB"]
