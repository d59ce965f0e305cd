"""`doctor --hardware-report`: what an adapter does, and what a person does by hand for it, as a report to send."""

import argparse
import json
import sys
from collections.abc import Iterator
from typing import Final

from gateway.cli.kit.progress import working
from gateway.cli.main import FINE
from gateway.clock.exact_loop import run_exactly
from gateway.errors import GatewayError, PortError
from gateway.ports.opener import make_opener
from gateway.ports.port import SerialSettings
from gateway.tools.hardware_report import (
    WATCHING,
    ReportRow,
    Section,
    look_at,
    read_for,
    wait_for_loss,
    wait_for_return,
)

_BY_HAND: Final = "By hand"
_UNPLUG: Final = "unplug the adapter, and plug it into the same socket again"
#: With a unit: what is done while it is read.
_MEANWHILE: Final = (
    ("take wire A (D+) off the adapter, and put it on again", "wire A off and on"),
    ("set the device to another parity, and do not change its rate", "another parity at the device"),
)
_PROMISE: Final = "It holds no name of this machine or its users, no address and no serial number."


class ReportError(GatewayError):
    """The report cannot be made."""


def make_report(args: argparse.Namespace) -> int:
    """Make the report and print it. Always 0, whatever the adapter does.

    Raises:
        ReportError: the port cannot be opened.
    """
    settings = SerialSettings(args.hardware_report, args.baud, args.format)
    asks = sys.stdin.isatty() and sys.stderr.isatty() and not args.json
    try:
        _say(f"Trying {settings.port}, which takes half a minute.")
        with working("trying"):
            sections = run_exactly(look_at(make_opener, settings, args.unit))
        sections.append(Section(_BY_HAND, list(_by_hand(settings, args.unit, asks=asks))))
    except PortError as error:
        remedy = "if a gateway uses this port: systemctl stop modbus-gateway"
        raise ReportError(f"{error}\n  help: {remedy}") from error
    print(as_json(sections) if args.json else as_text(sections))
    return FINE


def _by_hand(settings: SerialSettings, unit: int | None, *, asks: bool) -> Iterator[ReportRow]:
    """Ask for what only a person can do, or name it as not done."""
    if asks and _agrees(f"When you are told to: {_UNPLUG}."):
        yield run_exactly(wait_for_loss(make_opener, settings, lambda: _say("Unplug the adapter now.")))
        _say("Plug it in again.")
        yield run_exactly(wait_for_return(make_opener, settings))
    else:
        yield ReportRow("not done", _UNPLUG)
    for what, short in _MEANWHILE:
        if unit is not None and asks and _agrees(f"The unit will be read for {WATCHING:g} s. Meanwhile, {what}."):
            rows = run_exactly(read_for(make_opener, settings, unit, seconds=WATCHING))
            yield from (ReportRow(f"{short}: {row.what}", row.seen) for row in rows)
        else:
            yield ReportRow("not done", what if unit is not None else f"{what} (needs --unit)")


def _agrees(what: str) -> bool:
    _say(what)
    print("Enter to begin, s to skip: ", end="", file=sys.stderr, flush=True)
    return not sys.stdin.readline().strip()


def _say(text: str) -> None:
    print(text, file=sys.stderr, flush=True)


def as_text(sections: list[Section]) -> str:
    """Show the report for people."""
    width = max(len(row.what) for _, rows in sections for row in rows)
    lines = [f"Hardware report of modbus-gateway. {_PROMISE}"]
    for title, rows in sections:
        lines += ["", title, *(f"  {row.what:{width}}  {row.seen}" for row in rows)]
    return "\n".join(lines)


def as_json(sections: list[Section]) -> str:
    """Make the report for programs."""
    picture = [{"title": title, "rows": [row._asdict() for row in rows]} for title, rows in sections]
    return json.dumps({"sections": picture}, indent=2, ensure_ascii=False)
