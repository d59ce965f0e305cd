"""`events`: what has happened, also in earlier runs of the gateway, and with `-f` what happens."""

import argparse
import json
import sys
import time
from collections.abc import Iterable, Iterator
from dataclasses import replace
from datetime import datetime
from typing import Final

from gateway.cli.kit.daemon import Conversation, GatewayGoneError, add_control_argument, which_gateway
from gateway.cli.kit.paint import red, yellow
from gateway.cli.kit.usage import number_or_name, parsed_by
from gateway.cli.main import FINE
from gateway.config.values.duration import parse_duration
from gateway.operator.operations.answers.events import Told
from gateway.operator.operations.asked import ToList
from gateway.operator.operations.table import EVENTS

#: How often to look for what is new, in seconds; and how often the same event that goes on is printed at most.
_STEP: Final = 0.25
_AGAIN: Final = 60.0
#: How many events are printed if no time is given; before those that `-f` waits for.
_LAST: Final = 50
_LAST_BEFORE: Final = 10


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of `events`."""
    add = parser.add_argument
    add("-f", "--follow", action="store_true", help="go on with what happens, until Ctrl-C")
    add(
        "--since",
        type=parsed_by(parse_duration),
        metavar="TIME",
        help=f"events of the last 1h, 24h or 2days (default: the last {_LAST} events)",
    )
    add("--line", metavar="LINE", help="only this line or upstream, with its units")
    add("--unit", type=number_or_name, metavar="U", help="only this unit: the number that clients use, or a name")
    add("--client", metavar="CLIENT", help="only this client: its address, or the name of a user")
    add("--worst", action="store_true", help="only warnings and errors")
    add("--json", action="store_true", help="print JSON, an object on each line, instead of rows")
    add_control_argument(parser)


def run(args: argparse.Namespace) -> int:
    """Print what has happened; with `-f` also what happens until Ctrl-C, or until the gateway stops."""
    level = "warning" if args.worst else "info"
    chosen = ToList(level=level, line=args.line, unit=args.unit, client=args.client)
    last = None if args.since is not None else _LAST_BEFORE if args.follow else _LAST
    with Conversation(which_gateway(args)) as daemon:
        answer = daemon.ask(EVENTS, replace(chosen, since=args.since, count=last))
        for event in answer.events:
            _print(event, as_json=args.json)
        if not args.follow:
            if not answer.events and not args.json:
                print("no such event is kept", file=sys.stderr)
            return FINE
        try:
            for event in _new(_happening(daemon, replace(chosen, after=answer.next)), answer.events):
                _print(event, as_json=args.json)
        except GatewayGoneError:
            print("the gateway has stopped", file=sys.stderr)
    return FINE


def _happening(daemon: Conversation, asked: ToList) -> Iterator[Told]:
    while True:
        time.sleep(_STEP)
        answer = daemon.ask(EVENTS, asked)
        asked = replace(asked, after=answer.next)
        yield from answer.events


def _new(events: Iterator[Told], before: Iterable[Told]) -> Iterator[Told]:
    """Leave out an event that is only counted on, unless it was printed _AGAIN seconds ago."""
    printed = {event["number"]: time.monotonic() for event in before}
    for event in events:
        now = time.monotonic()
        printed = {number: at for number, at in printed.items() if now - at < _AGAIN}
        if event["number"] not in printed:
            printed[event["number"]] = now
            yield event


def _print(event: Told, *, as_json: bool) -> None:
    print(json.dumps(event, ensure_ascii=False) if as_json else _row(event), flush=True)


def _row(event: Told) -> str:
    more = f"  ({event['times']} times since {_clock(event['since'])})" if event["times"] > 1 else ""
    level = {"error": red, "warning": yellow}.get(event["level"], str)(f"{event['level']:7}")
    return f"{_clock(event['timestamp'])}  {level}  {event['event']:17}  {event['text']}{more}"


def _clock(text: str) -> str:
    return f"{datetime.fromisoformat(text).astimezone():%Y-%m-%d %H:%M:%S}"
