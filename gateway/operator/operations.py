"""All operations: what may be asked of a gateway at work, by name, with the types of question and answer.

Nothing here loads what answers, or the types of answers: the commands of this program use the same table, and start
quickly.
"""

from dataclasses import dataclass
from typing import TYPE_CHECKING, Annotated, Any, Final

from gateway.operator.operation import Nothing, Operation
from gateway.operator.parameters import Within
from gateway.trace.records import MOST_STORIES

if TYPE_CHECKING:
    from gateway.operator.answers.bench import BenchStep
    from gateway.operator.answers.doctor import Examination
    from gateway.operator.answers.fleet import Sites
    from gateway.operator.answers.forgotten import Forgotten
    from gateway.operator.answers.measured import Measured
    from gateway.operator.answers.running import Reloaded, Which
    from gateway.operator.answers.scan import ScanStep
    from gateway.operator.answers.status import Status
    from gateway.operator.answers.trace import Stories, TracePage
    from gateway.operator.answers.unit import RequestAnswer, UnitPicture

#: A unit: the number that clients use, or its name.
UnitNamed = Annotated[int | str, "a number from 0 to 255, or a name"]
LineNamed = Annotated[str, "the name of a line"]


@dataclass(frozen=True, slots=True)
class OneUnit:
    """The `unit` that is meant."""

    unit: UnitNamed


@dataclass(frozen=True, slots=True)
class OneDevice:
    """The `device` that is meant."""

    device: UnitNamed


@dataclass(frozen=True, slots=True)
class OneRequest:
    """A request to `unit`: its `pdu` in hexadecimal."""

    unit: UnitNamed
    pdu: Annotated[str, 'bytes in hexadecimal, such as "03 00 00 00 02"']


@dataclass(frozen=True, slots=True)
class ToExamine:
    """The `line`, server line or upstream to examine, or all. Unless it may `ask`, nothing is sent."""

    line: LineNamed | None = None
    ask: bool = True


@dataclass(frozen=True, slots=True)
class Traced:
    """Records from number `after` on; or those of the last `since` seconds, or the last few.

    `line`, `unit`, `function`, `client` and `result` choose among them. With `lines` the answer has the lines too.
    """

    after: int | None = None
    since: float | None = None
    line: str | None = None
    unit: int | str | None = None
    function: int | None = None
    client: str | None = None
    result: str | None = None
    lines: bool = False


@dataclass(frozen=True, slots=True)
class ToExplain:
    """The last `count` failed requests of `who`: a unit by number or name, a line, or a client by name or address.

    With a `line`, only those on it.
    """

    who: Annotated[str, 'a unit, or a client such as "10.2.0.7"']
    count: Annotated[int, Within(1, MOST_STORIES), f"1 to {MOST_STORIES}"] = 5
    line: str | None = None


@dataclass(frozen=True, slots=True)
class ToMeasure:
    """The `line` to read as fast as it goes for some `seconds`, all its units or one, some `items` from `address` on.

    With `progress` it is told each second how far the measurement is.
    """

    line: LineNamed
    unit: UnitNamed | None = None
    seconds: Annotated[float, Within(0.001, 3600), "a number above 0, 3600 at most"] = 60.0
    items: Annotated[int, Within(1, 2000), "a number above 0, 2000 at most"] = 10
    address: Annotated[int | None, Within(0, 65535), "a number from 0 to 65535"] = None
    progress: bool = False


@dataclass(frozen=True, slots=True)
class ToScan:
    """The `line` to scan, for the `units` or all numbers; an answer has `limit_s` seconds.

    With `all_speeds` it is scanned at all usual rates.
    """

    line: LineNamed
    units: Annotated[int | str | list[Any] | None, 'units such as "1-32"'] = None
    limit_s: Annotated[float, Within(0.001, 10), "more than 0 and at most 10 s"] = 0.3
    all_speeds: bool = False


STATUS: Final[Operation[Nothing, "Status"]] = Operation(
    "status",
    Nothing,
    "gateway.operator.answers.status:Status",
    "reading",
    "How the gateway is doing",
    by="gateway.operator.status:tell_status",
    key="status",
    path="/status",
)
WHICH: Final[Operation[Nothing, "Which"]] = Operation(
    "which",
    Nothing,
    "gateway.operator.answers.running:Which",
    "reading",
    "The config with which the gateway runs",
    by="gateway.operator.running:tell_which",
)
FLEET: Final[Operation[Nothing, "Sites"]] = Operation(
    "fleet",
    Nothing,
    "gateway.operator.answers.fleet:Sites",
    "reading",
    "The sites of the fleet",
    by="gateway.operator.running:tell_sites",
)
RELOAD: Final[Operation[Nothing, "Reloaded"]] = Operation(
    "reload",
    Nothing,
    "gateway.operator.answers.running:Reloaded",
    "operator",
    "Read the config again",
    by="gateway.operator.running:reload",
)
UNIT: Final[Operation[OneUnit, "UnitPicture"]] = Operation(
    "unit",
    OneUnit,
    "gateway.operator.answers.unit:UnitPicture",
    "reading",
    "A unit with its points, as clients have to know it",
    by="gateway.operator.units:tell_unit",
    key="unit",
)
REQUEST: Final[Operation[OneRequest, "RequestAnswer"]] = Operation(
    "request",
    OneRequest,
    "gateway.operator.answers.unit:RequestAnswer",
    "operator",
    "Send a request to a unit, as any client does",
    by="gateway.operator.requests:ask",
)
FORGET: Final[Operation[OneDevice, "Forgotten"]] = Operation(
    "forget",
    OneDevice,
    "gateway.operator.answers.forgotten:Forgotten",
    "operator",
    "Ask a device that moved where the config says again",
    by="gateway.operator.forgetting:forget_device",
    key="forgotten",
)
DOCTOR: Final[Operation[ToExamine, "Examination"]] = Operation(
    "doctor",
    ToExamine,
    "gateway.operator.answers.doctor:Examination",
    "operator",
    "Find what is wrong with lines, units and clients",
    by="gateway.tools.doctor:examine",
)
TRACE: Final[Operation[Traced, "TracePage"]] = Operation(
    "trace",
    Traced,
    "gateway.operator.answers.trace:TracePage",
    "reading",
    "What has passed on the lines",
    by="gateway.operator.trace:tell_page",
)
WHY: Final[Operation[ToExplain, "Stories"]] = Operation(
    "why",
    ToExplain,
    "gateway.operator.answers.trace:Stories",
    "reading",
    "Why requests failed",
    by="gateway.operator.trace:tell_stories",
)
BENCH: Final[Operation[ToMeasure, "BenchStep"]] = Operation(
    "bench",
    ToMeasure,
    "gateway.operator.answers.bench:BenchStep",
    "operator",
    "Measure what a line carries",
    by="gateway.tools.bench:measure",
    is_repeated=True,
)
TIMES: Final[Operation[OneUnit, "Measured"]] = Operation(
    "times",
    OneUnit,
    "gateway.operator.answers.measured:Measured",
    "reading",
    "How long a device needs to respond",
    by="gateway.operator.calibration:tell_times",
    key="times",
)
SCAN: Final[Operation[ToScan, "ScanStep"]] = Operation(
    "scan",
    ToScan,
    "gateway.operator.answers.scan:ScanStep",
    "operator",
    "Find the units that answer on a line",
    by="gateway.tools.scans:scan",
    is_repeated=True,
)

OPERATIONS: Final[tuple[Operation[Any, Any], ...]] = (
    STATUS,
    WHICH,
    FLEET,
    RELOAD,
    UNIT,
    REQUEST,
    FORGET,
    DOCTOR,
    TRACE,
    WHY,
    BENCH,
    TIMES,
    SCAN,
)

#: The same, by name.
BY_NAME: Final = {each.name: each for each in OPERATIONS}
