"""The table of all operations, by name, with the types of parameters and results.

A new one is described here. The function that answers is at `by`; its parameters and its result are dataclasses in
`asked` and `answers`.

Neither these functions nor the types of results are loaded here: the commands of this program use the same table, and
must start quickly.
"""

from typing import TYPE_CHECKING, Any, Final

from gateway.errors import ChangedMeanwhile, DoesNotFit, ExceptionReceived, Unready, WrongQuestion
from gateway.operator.operations.asked import (
    Addresses,
    KnownOf,
    OneDevice,
    OneLine,
    OneRequest,
    OneUnit,
    PastOfLine,
    PastOfUnit,
    PointsToRead,
    PointsToWrite,
    PointToRead,
    PointToWrite,
    TextToCheck,
    ToExamine,
    ToExplain,
    ToList,
    ToMeasure,
    ToScan,
    ToSupport,
    ToUnderstand,
    Traced,
    TrendOfPoint,
    ValuesToWrite,
)
from gateway.operator.operations.operation import Nothing, Operation

if TYPE_CHECKING:
    from gateway.operator.operations.answers.bench import BenchStep
    from gateway.operator.operations.answers.config import CheckedConfig, ConfigInUse
    from gateway.operator.operations.answers.doctor import Examination
    from gateway.operator.operations.answers.events import Happened
    from gateway.operator.operations.answers.forget import Forgotten
    from gateway.operator.operations.answers.inventory import Inventory
    from gateway.operator.operations.answers.known_values import KnownValues
    from gateway.operator.operations.answers.past import LinePast, UnitPast
    from gateway.operator.operations.answers.running import Reloaded, Which
    from gateway.operator.operations.answers.scan import ScanStep
    from gateway.operator.operations.answers.status import AnyLine, Lines, Sites, Status
    from gateway.operator.operations.answers.support import Document
    from gateway.operator.operations.answers.times import Measured
    from gateway.operator.operations.answers.trace import Meanings, Stories, TracePage
    from gateway.operator.operations.answers.trend import PointTrend
    from gateway.operator.operations.answers.unit import RequestAnswer, UnitPicture, Units
    from gateway.operator.operations.answers.unit_status import UnitWithStatus
    from gateway.operator.operations.answers.values import Cells, Points, Values

#: Why a read or write of a unit may be refused.
_READING: Final = (WrongQuestion, ChangedMeanwhile, DoesNotFit, ExceptionReceived)
_A_UNIT: Final = "/units/{unit}"
_ADDRESSES: Final = "{area}/{start}-{end}"

STATUS: Final[Operation[Nothing, "Status"]] = Operation(
    "status",
    Nothing,
    "gateway.operator.operations.answers.status:Status",
    "reading",
    "How the gateway is doing",
    by="gateway.operator.status.status:tell_status",
    key="status",
    path="/status",
    is_large=True,
)
WHICH: Final[Operation[Nothing, "Which"]] = Operation(
    "which",
    Nothing,
    "gateway.operator.operations.answers.running:Which",
    "reading",
    "The config with which the gateway runs",
    by="gateway.operator.config.reload:tell_which",
)
INVENTORY: Final[Operation[Nothing, "Inventory"]] = Operation(
    "inventory",
    Nothing,
    "gateway.operator.operations.answers.inventory:Inventory",
    "reading",
    "What this gateway is and has: version, config, adapters, lines, devices, certificates",
    by="gateway.operator.fleet.inventory:tell_inventory",
    path="/inventory",
)
FLEET: Final[Operation[Nothing, "Sites"]] = Operation(
    "fleet",
    Nothing,
    "gateway.operator.operations.answers.status:Sites",
    "reading",
    "The sites of the fleet: how they are doing, and what each is and has",
    by="gateway.operator.fleet.inventory:tell_sites",
    path="/fleet",
    refuses=(WrongQuestion,),
)
RELOAD: Final[Operation[Nothing, "Reloaded"]] = Operation(
    "reload",
    Nothing,
    "gateway.operator.operations.answers.running:Reloaded",
    "operator",
    "Read the config again",
    by="gateway.operator.config.reload:reload",
    path="/reload",
    method="POST",
    refuses=(DoesNotFit, Unready),
)
CONFIG: Final[Operation[Nothing, "ConfigInUse"]] = Operation(
    "config",
    Nothing,
    "gateway.operator.operations.answers.config:ConfigInUse",
    "reading",
    "The config in use, without comments and secrets",
    by="gateway.operator.config.check:tell_config",
    path="/config",
)
CHECK_CONFIG: Final[Operation[TextToCheck, "CheckedConfig"]] = Operation(
    "check-config",
    TextToCheck,
    "gateway.operator.operations.answers.config:CheckedConfig",
    "operator",
    "Check a text, and compare it with the config in use",
    by="gateway.operator.config.check:check_config",
    key="checked",
    path="/config/check",
    method="POST",
    refuses=(Unready,),
)
LINES: Final[Operation[Nothing, "Lines"]] = Operation(
    "lines",
    Nothing,
    "gateway.operator.operations.answers.status:Lines",
    "reading",
    "Lines, lines where the gateway is the server, other servers",
    by="gateway.operator.status.status:tell_lines",
    path="/lines",
)
LINE: Final[Operation[OneLine, "AnyLine"]] = Operation(
    "line",
    OneLine,
    "gateway.operator.operations.answers.status:AnyLine",
    "reading",
    "A line, a line where the gateway is the server, or another server",
    by="gateway.operator.status.status:tell_line",
    key="line",
    path="/lines/{name}",
    refuses=(WrongQuestion,),
)
LINE_HISTORY: Final[Operation[PastOfLine, "LinePast"]] = Operation(
    "line-history",
    PastOfLine,
    "gateway.operator.operations.answers.past:LinePast",
    "reading",
    "What a line, or another server, did in the last hours",
    by="gateway.operator.past.past:tell_line",
    path="/lines/{name}/history",
    refuses=(WrongQuestion,),
)
UNITS: Final[Operation[Nothing, "Units"]] = Operation(
    "units",
    Nothing,
    "gateway.operator.operations.answers.unit:Units",
    "reading",
    "Every unit",
    by="gateway.operator.units.units:tell_units",
    path="/units",
    is_large=True,
)
UNIT: Final[Operation[OneUnit, "UnitPicture"]] = Operation(
    "unit",
    OneUnit,
    "gateway.operator.operations.answers.unit:UnitPicture",
    "reading",
    "A unit with its points, as clients have to know it",
    by="gateway.operator.units.units:tell_unit",
    key="unit",
)
UNIT_STATUS: Final[Operation[OneUnit, "UnitWithStatus"]] = Operation(
    "unit-status",
    OneUnit,
    "gateway.operator.operations.answers.unit_status:UnitWithStatus",
    "reading",
    "A unit, its points and its status",
    by="gateway.operator.status.status:tell_unit_with_status",
    key="unit",
    path=_A_UNIT,
    refuses=(WrongQuestion,),
)
UNIT_HISTORY: Final[Operation[PastOfUnit, "UnitPast"]] = Operation(
    "unit-history",
    PastOfUnit,
    "gateway.operator.operations.answers.past:UnitPast",
    "reading",
    "What a unit did in the last hours",
    by="gateway.operator.past.past:tell_unit",
    path=f"{_A_UNIT}/history",
    refuses=(WrongQuestion,),
)
VALUES: Final[Operation[KnownOf, "KnownValues"]] = Operation(
    "values",
    KnownOf,
    "gateway.operator.operations.answers.known_values:KnownValues",
    "reading",
    "The latest known values of all points, without asking a device",
    by="gateway.operator.values.known_values:tell_values",
    path="/values",
    refuses=(WrongQuestion,),
    is_large=True,
)
VALUE_HISTORY: Final[Operation[TrendOfPoint, "PointTrend"]] = Operation(
    "value-history",
    TrendOfPoint,
    "gateway.operator.operations.answers.trend:PointTrend",
    "reading",
    "The trend of a point: least, mean and greatest values",
    by="gateway.operator.trends.told:tell_trend",
    path="/values/{device}/{point}/history",
    refuses=(WrongQuestion,),
)
POINTS: Final[Operation[PointsToRead, "Points"]] = Operation(
    "points",
    PointsToRead,
    "gateway.operator.operations.answers.values:Points",
    "reading",
    "All points of a unit that can be read",
    by="gateway.operator.values.reading_and_writing:read_points",
    path=f"{_A_UNIT}/points",
    refuses=_READING,
)
POINT: Final[Operation[PointToRead, "Values"]] = Operation(
    "point",
    PointToRead,
    "gateway.operator.operations.answers.values:Values",
    "reading",
    "One point of a unit",
    by="gateway.operator.values.reading_and_writing:read_point",
    path=f"{_A_UNIT}/points/{{name}}",
    refuses=_READING,
)
READ: Final[Operation[Addresses, "Values"]] = Operation(
    "read",
    Addresses,
    "gateway.operator.operations.answers.values:Values",
    "reading",
    "Values of a unit by their addresses",
    by="gateway.operator.values.reading_and_writing:read_values",
    path=f"{_A_UNIT}/{_ADDRESSES}",
    refuses=_READING,
)
WRITE_POINTS: Final[Operation[PointsToWrite, "Values"]] = Operation(
    "write-points",
    PointsToWrite,
    "gateway.operator.operations.answers.values:Values",
    "writing",
    "Write points that lie side by side, with one request",
    by="gateway.operator.values.reading_and_writing:write_points",
    path=f"{_A_UNIT}/points",
    method="PUT",
    refuses=_READING,
)
WRITE_POINT: Final[Operation[PointToWrite, "Values"]] = Operation(
    "write-point",
    PointToWrite,
    "gateway.operator.operations.answers.values:Values",
    "writing",
    "Write one point",
    by="gateway.operator.values.reading_and_writing:write_point",
    path=f"{_A_UNIT}/points/{{name}}",
    method="PUT",
    refuses=_READING,
)
WRITE: Final[Operation[ValuesToWrite, "Values"]] = Operation(
    "write",
    ValuesToWrite,
    "gateway.operator.operations.answers.values:Values",
    "writing",
    "Write values of a unit by their addresses, with one request",
    by="gateway.operator.values.reading_and_writing:write_values",
    path=f"{_A_UNIT}/{_ADDRESSES}",
    method="PUT",
    refuses=_READING,
)
IMAGE: Final[Operation[Addresses, "Cells"]] = Operation(
    "image",
    Addresses,
    "gateway.operator.operations.answers.values:Cells",
    "reading",
    "What an image or mirror has, without asking a device",
    by="gateway.operator.images.cells:tell_image",
    path=f"/images/{{unit}}/{_ADDRESSES}",
    refuses=(WrongQuestion,),
)
REQUEST: Final[Operation[OneRequest, "RequestAnswer"]] = Operation(
    "request",
    OneRequest,
    "gateway.operator.operations.answers.unit:RequestAnswer",
    "operator",
    "Send a request to a unit, as any client does",
    by="gateway.operator.values.requests:ask",
)
FORGET: Final[Operation[OneDevice, "Forgotten"]] = Operation(
    "forget",
    OneDevice,
    "gateway.operator.operations.answers.forget:Forgotten",
    "operator",
    "Ask a device that moved where the config says again",
    by="gateway.operator.units.forgetting:forget_device",
    key="forgotten",
)
DOCTOR: Final[Operation[ToExamine, "Examination"]] = Operation(
    "doctor",
    ToExamine,
    "gateway.operator.operations.answers.doctor:Examination",
    "operator",
    "Find what is wrong with lines, units and clients",
    by="gateway.tools.doctor:examine",
)
TRACE: Final[Operation[Traced, "TracePage"]] = Operation(
    "trace",
    Traced,
    "gateway.operator.operations.answers.trace:TracePage",
    "reading",
    "What has passed on the lines",
    by="gateway.operator.trace.trace:tell_page",
)
MEANING: Final[Operation[ToUnderstand, "Meanings"]] = Operation(
    "meaning",
    ToUnderstand,
    "gateway.operator.operations.answers.trace:Meanings",
    "reading",
    "What a request and its response mean: the values of all points in them",
    by="gateway.operator.trace.meanings:tell_meaning",
    path=f"{_A_UNIT}/meaning",
    refuses=(WrongQuestion,),
)
WHY: Final[Operation[ToExplain, "Stories"]] = Operation(
    "why",
    ToExplain,
    "gateway.operator.operations.answers.trace:Stories",
    "reading",
    "Why requests failed",
    by="gateway.operator.trace.why:tell_stories",
)
EVENTS: Final[Operation[ToList, "Happened"]] = Operation(
    "events",
    ToList,
    "gateway.operator.operations.answers.events:Happened",
    "reading",
    "The last events, kept over a restart",
    by="gateway.operator.past.events:tell_events",
    path="/events/last",
    refuses=(WrongQuestion,),
)
BENCH: Final[Operation[ToMeasure, "BenchStep"]] = Operation(
    "bench",
    ToMeasure,
    "gateway.operator.operations.answers.bench:BenchStep",
    "operator",
    "Measure what a line carries",
    by="gateway.tools.bench:measure",
    is_repeated=True,
)
TIMES: Final[Operation[OneUnit, "Measured"]] = Operation(
    "times",
    OneUnit,
    "gateway.operator.operations.answers.times:Measured",
    "reading",
    "How long a device needs to respond",
    by="gateway.operator.units.calibration:tell_times",
    key="times",
)
SCAN: Final[Operation[ToScan, "ScanStep"]] = Operation(
    "scan",
    ToScan,
    "gateway.operator.operations.answers.scan:ScanStep",
    "operator",
    "Find the units that answer on a line",
    by="gateway.tools.scans:scan",
    is_repeated=True,
)

SUPPORT: Final[Operation[ToSupport, "Document"]] = Operation(
    "support",
    ToSupport,
    "gateway.operator.operations.answers.support:Document",
    "operator",
    "What a diagnostics bundle has of a running gateway",
    by="gateway.tools.support:tell_all",
    is_repeated=True,
)

#: All of them, in this order.
OPERATIONS: Final[tuple[Operation[Any, Any], ...]] = tuple(
    each for each in globals().values() if isinstance(each, Operation)
)

#: All operations by name.
BY_NAME: Final = {each.name: each for each in OPERATIONS}
