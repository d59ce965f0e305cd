"""`status`: the state of the running gateway."""

import argparse
import json
import os
import shutil
import sys
import textwrap
import time
from collections.abc import Callable, Iterable, Iterator, Mapping
from math import ceil
from typing import Any, Final

from gateway.cli.kit.columns import align, narrow
from gateway.cli.kit.daemon import NOT_UNDERSTOOD, UNKNOWN, add_control_argument, ask, which_gateway
from gateway.cli.kit.terminal import unescaped
from gateway.cli.main import FINE
from gateway.cli.show.advice import ADVICE, count_failed, count_ok
from gateway.config.values.duration import show_age, show_duration
from gateway.errors import DaemonError
from gateway.observe.printable import printable

#: The interval of `-w`, in seconds.
_WATCH_STEP: Final = 1.0
#: The text of an empty cell.
_NOTHING: Final = "-"
_INDENT: Final = "  "

#: At most this many users of each line are shown.
_USERS_SHOWN: Final = 3

#: Terminal sequences: go to the upper left; clear to the end of the line; clear below.
_HOME: Final = "\x1b[H"
_CLEAR_LINE: Final = "\x1b[K"
_CLEAR_BELOW: Final = "\x1b[J"

#: A key of a row, or a function from the row to the text.
_Column = str | Callable[[Mapping[str, Any]], object]


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """The arguments of `status`."""
    add_control_argument(parser)
    parser.add_argument("-w", "--watch", action="store_true", help="show it again every second, until Ctrl-C")
    parser.add_argument("--fleet", action="store_true", help="show all sites of the fleet instead of this gateway")
    parser.add_argument("--json", action="store_true", help="print JSON instead of tables")


def run(args: argparse.Namespace) -> int:
    """Print the gateway's status.

    Raises:
        DaemonError: no gateway answers.
    """
    in_place = args.watch and not args.json and sys.stdout.isatty() and not os.environ.get("NO_COLOR")
    while True:
        status = _ask(args)
        columns, rows = shutil.get_terminal_size()
        if args.json:
            print(json.dumps(status, indent=None if args.watch else 2), flush=True)
        elif in_place:
            print(end=_redraw(show_status(status, columns), rows), file=unescaped(sys.stdout), flush=True)
        else:
            print(show_status(status, columns), end="\n\n" if args.watch else "\n", flush=True)
        if not args.watch:
            return FINE
        time.sleep(_WATCH_STEP)


def _ask(args: argparse.Namespace) -> Mapping[str, Any]:
    """The status, or that of all sites."""
    gateway = which_gateway(args)
    status = ask("fleet", gateway) if args.fleet else ask("status", gateway).get("status")
    if not isinstance(status, dict):
        raise DaemonError("the gateway's answer has no status in it")
    return {"sites": status.get("sites")} if args.fleet else status


def _redraw(text: str, rows: int) -> str:
    """`text` with the sequences that draw it over the present content of a terminal with this many rows."""
    lines = printable(text).splitlines()
    if len(lines) >= rows:
        lines = [*lines[: rows - 2], f"{len(lines) - rows + 2} more lines: make the window higher"]
    return _HOME + "".join(f"{line}{_CLEAR_LINE}\n" for line in lines) + _CLEAR_BELOW


def show_status(status: Mapping[str, Any], width: int = 80) -> str:
    """The status as tables, `width` characters wide unless names and addresses are too long."""
    if "sites" in status:
        return _table("Sites", _rows(status, "sites"), _SITES, width)
    units = _rows(status, "units")
    asked = [unit for unit in units or () if _cell(_was_polled, unit)]
    users = list(_users(_rows(status, "lines") or (), units or ()))
    shown = {**status, "units": None if units is None else asked, "users": users}
    parts = ["   ".join(str(status[fact]) for fact in ("site", "page") if status.get(fact))]
    parts += [_table(title, _rows(shown, section), columns, width) for title, section, columns in _TABLES]
    parts.append(_notes(shown, width))
    silent = len(units or ()) - len(asked)
    if silent:
        parts.append(f"{silent} unit{' has' if silent == 1 else 's have'} not been polled yet.")
    return "\n\n".join(part for part in parts if part)


def _users(lines: Iterable[Any], units: Iterable[Any]) -> Iterator[Mapping[str, Any]]:
    """Who takes most of each line's time, each with the unit that its clients use, not the address on the wire."""
    numbers = {str(_cell("name", unit)): _cell("unit", unit) for unit in units}
    for line in lines:
        users = _cell("users", line)
        for user in (users if isinstance(users, list) else ())[:_USERS_SHOWN]:
            if _cell("share", user) not in (UNKNOWN, 0):
                yield {"line": _cell("name", line), **user, "unit": numbers.get(str(_cell("device", user)), _NOTHING)}


def _rows(status: Mapping[str, Any], section: str) -> list[Any] | None:
    """A section of the status; None if this gateway does not have it."""
    rows = status.get(section)
    return rows if isinstance(rows, list) else None


def _table(title: str, rows: list[Any] | None, columns: Mapping[str, _Column], width: int) -> str:
    if rows is None:
        return f"{title}\n  {UNKNOWN}"
    if not rows:
        return ""
    cells = [tuple(columns), *([str(_cell(column, row)) for column in columns.values()] for row in rows)]
    flexible = [place for place, heading in enumerate(columns) if heading in _FLEXIBLE]
    return f"{title}\n{align(narrow(cells, flexible, width - len(_INDENT)), _INDENT)}"


def _notes(status: Mapping[str, Any], width: int) -> str:
    """The notes, a paragraph for each."""
    notes = [
        textwrap.fill(f"{_name(row)}: {note}", width, initial_indent=_INDENT, subsequent_indent=2 * _INDENT)
        for section, advise in ADVICE.items()
        for row in _rows(status, section) or ()
        for note in _told(advise, row)
    ]
    return "\n".join(["Notes", *notes]) if notes else ""


def _name(row: Mapping[str, Any]) -> str:
    return f"unit {row['unit']}, {_cell('name', row)}" if "unit" in row else str(_cell("name", row))


def _told(advise: Callable[[Mapping[str, Any]], Iterator[str]], row: Any) -> list[str]:
    """The notes about a row; none if another version's gateway has sent it in another form."""
    try:
        return list(advise(row))
    except NOT_UNDERSTOOD:
        return []


def _cell(column: _Column, row: Any) -> object:
    """The text in a column. A gateway of another version may lack the value, or send it in another form."""
    try:
        return row[column] if isinstance(column, str) else column(row)
    except NOT_UNDERSTOOD:
        return UNKNOWN


def _was_polled(unit: Mapping[str, Any]) -> bool:
    return bool(unit["counts"]["sent"] or unit["counts"]["refused"] or unit["state"] != "fine" or count_failed(unit))


def _at(unit: Mapping[str, Any]) -> str:
    return f"{unit['line']}/{unit['on_the_wire']}"


def _speed(line: Mapping[str, Any]) -> str:
    return f"{line['baud']} {line['format']}"


def _busy(line: Mapping[str, Any]) -> str:
    return _share(line["busy_share"])


def _per_second(line: Mapping[str, Any]) -> str:
    rate = line["requests_per_s"]
    return _NOTHING if rate is None else f"{rate:.1f}"


def _user_share(user: Mapping[str, Any]) -> str:
    return f"{100 * user['share']:.1f} %"


def _user_rate(user: Mapping[str, Any]) -> str:
    return f"{user['requests_per_s']:.1f}"


def _last_answer(unit: Mapping[str, Any]) -> str:
    return _age(unit["last_answer_ms"])


def _show_last_request(client: Mapping[str, Any]) -> str:
    return _age(client["asked_ms"])


def _p50(unit: Mapping[str, Any]) -> str:
    return _milliseconds(unit["times"]["answer_p50_ms"])


def _p99(unit: Mapping[str, Any]) -> str:
    return _milliseconds(unit["times"]["answer_p99_ms"])


def _limit(unit: Mapping[str, Any]) -> str:
    return _milliseconds(unit["times"]["limit_ms"])


def _answered(unit: Mapping[str, Any]) -> str:
    """The share of requests that were answered; 100 % only if all were."""
    ok, failed = count_ok(unit), count_failed(unit)
    return _NOTHING if not ok + failed else f"{100 * ok // (ok + failed)} %"


def _longest_wait(unit: Mapping[str, Any]) -> str:
    return show_duration(ceil(unit["longest_wait_ms"] / 10) / 100)


def _count_answered(server: Mapping[str, Any]) -> int:
    return int(server["counts"]["responses"])


def _since(site: Mapping[str, Any]) -> str:
    return show_age(1000 * site["for_s"])


def _lines_down(site: Mapping[str, Any]) -> str:
    return ", ".join(site["lines_down"]) or _NOTHING


def _is_held(lease: Mapping[str, Any]) -> str:
    return "yes" if lease["is_held"] else "no"


def _reachable(lease: Mapping[str, Any]) -> str:
    return lease["trouble"] or "answers"


def _down_for(broker: Mapping[str, Any]) -> str:
    return _age(broker["down_ms"])


def _broker_reason(broker: Mapping[str, Any]) -> str:
    reason: str = broker["reason"] or broker.get("unsteady", "")
    return reason


def _online(broker: Mapping[str, Any]) -> str:
    return f"{broker['available']} of {broker['devices']}"


def _ages(mirror: Mapping[str, Any]) -> str:
    return ", ".join(f"{each['addresses']}: {_age_of_values(each['age_ms'])}" for each in mirror["ranges"])


def _age_of_values(age: float | None) -> str:
    return "not known" if age is None else f"{age / 1000:.1f} s"


def _age(age: float | None) -> str:
    return _NOTHING if age is None else show_age(age)


def _milliseconds(value: float | None) -> str:
    return _NOTHING if value is None else f"{value:.1f}" if value < 10 else f"{value:.0f}"


def _share(share: float | None) -> str:
    return _NOTHING if share is None else f"{100 * share:.0f} %"


#: The columns whose texts may be shortened.
_FLEXIBLE: Final = frozenset(
    {"NAME", "PORT", "ADDRESS", "AT", "DEVICE", "OF", "AGES", "CLIENT", "LISTENER", "REASON", "DOWN"}
)

#: The columns of sites.
_SITES: Final[Mapping[str, _Column]] = {
    "SITE": "site",
    "STATE": "state",
    "FOR": _since,
    "HOST": "host",
    "LINES UP": "lines",
    "DOWN": _lines_down,
    "UNITS": "units",
    "VERSION": "version",
}

#: The tables: heading, section of the status, and columns.
_TABLES: Final[tuple[tuple[str, str, Mapping[str, _Column]], ...]] = (
    ("State directory", "state_files", {"FILE": "file", "STATE": "state", "REASON": "reason"}),
    (
        "Lines (busy and requests/s: of the last minute)",
        "lines",
        {
            "NAME": "name",
            "PORT": "port",
            "SPEED": _speed,
            "STATE": "state",
            "BUSY": _busy,
            "REQ/S": _per_second,
            "WAITING": "queue",
            "ERRORS": count_failed,
        },
    ),
    (
        "Users of the lines (of the last minute)",
        "users",
        {
            "LINE": "line",
            "CLIENT": "client",
            "UNIT": "unit",
            "DEVICE": "device",
            "FUNCTION": "function",
            "SHARE": _user_share,
            "REQ/S": _user_rate,
        },
    ),
    (
        "Units (answer times in ms)",
        "units",
        {
            "UNIT": "unit",
            "AT": _at,
            "DEVICE": "name",
            "STATE": "state",
            "LAST": _last_answer,
            "P50": _p50,
            "P99": _p99,
            "LIMIT": _limit,
            "ANSWERED": _answered,
            "MAX-WAIT": _longest_wait,
        },
    ),
    (
        "Certificates",
        "certificates",
        {"USED BY": "used_by", "KEY": "key", "FILE": "file", "SUBJECT": "subject", "UNTIL": "until"},
    ),
    (
        "Upstreams",
        "upstreams",
        {
            "NAME": "name",
            "ADDRESS": "to",
            "STATE": "state",
            "WAITING": "queue",
            "OK": count_ok,
            "ERRORS": count_failed,
        },
    ),
    (
        "Broker",
        "brokers",
        {
            "ADDRESS": "broker",
            "STATE": "state",
            "DOWN FOR": _down_for,
            "REASON": _broker_reason,
            "DEVICES": _online,
            "MESSAGES": "messages",
            "REFUSED": "refused_messages",
            "COMMANDS": "commands",
            "POLLS": "polls",
            "FAILED": "failed_polls",
        },
    ),
    (
        "Leases",
        "leases",
        {
            "LEASE": "name",
            "LINE": "line",
            "HELD HERE": _is_held,
            "HOLDER": "holder",
            "TAKEN": "taken",
            "NATS": _reachable,
        },
    ),
    (
        "Fleet",
        "fleets",
        {
            "NATS": "server",
            "SITE": "site",
            "STATE": "state",
            "DOWN FOR": _down_for,
            "REASON": "reason",
            "REQUESTS": "requests",
            "RESPONSES": "responses",
            "EXPIRED": "expired",
        },
    ),
    (
        "Server lines",
        "servers",
        {"NAME": "name", "PORT": "port", "SPEED": _speed, "STATE": "state", "ANSWERED": _count_answered},
    ),
    ("Images", "images", {"UNIT": "unit", "NAME": "name", "REQUESTS": "requests", "EXCEPTIONS": "exceptions"}),
    ("Mirrors", "mirrors", {"UNIT": "unit", "NAME": "name", "OF": "of", "REQUESTS": "requests", "AGES": _ages}),
    ("Listeners", "listeners", {"NAME": "name", "ADDRESS": "address", "CLIENTS": "clients", "REJECTED": "rejected"}),
    ("Clients", "clients", {"CLIENT": "client", "LISTENER": "listener", "LAST": _show_last_request}),
)
