"""`trace`: what passes on the lines, live or from the gateway's ring, as rows, as a capture file, or as stories."""

import argparse
import json
import shutil
import sys
import time
from collections.abc import Iterator
from contextlib import ExitStack
from dataclasses import replace
from pathlib import Path
from typing import BinaryIO, Final

from gateway.cli.kit.daemon import Conversation, add_control_argument, which_gateway
from gateway.cli.kit.usage import WrongUsageError, count, let_options_stand_anywhere, number_or_name, parsed_by
from gateway.cli.main import FINE, PROBLEM_FOUND
from gateway.cli.show.trace_rows import rows
from gateway.config.values.duration import parse_duration
from gateway.errors import DaemonError
from gateway.operator.operations.answers.trace import Fact
from gateway.operator.operations.asked import ToExplain, Traced
from gateway.operator.operations.table import TRACE, WHY
from gateway.operator.trace.capture import description, packets
from gateway.operator.trace.stories import told
from gateway.trace.pcapng import Writer
from gateway.trace.records import MOST_STORIES
from gateway.version import __version__

#: How often to look for what is new, in seconds.
_STEP: Final = 0.1
#: How many stories are told when nobody says it.
_STORIES: Final = 5
#: Longer than the ring of any gateway reaches back.
_ALWAYS: Final = 7 * 24 * 3600.0

_ABOUT: Final = """\
>  to the line, <  from it, x  a request that was not sent, -  no response,
!  a port was opened or lost
"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of `trace`."""
    parser.epilog = _ABOUT
    add = parser.add_argument
    add("line", nargs="?", metavar="LINE", help="the line or upstream to look at (default: all)")
    add("--unit", type=number_or_name, metavar="U", help="only this unit: the number that clients use, or a name")
    add(
        "--since",
        type=parsed_by(parse_duration),
        metavar="TIME",
        help="show what happened in the last 5min, 24h or 2days, and exit",
    )
    add("--why", metavar="WHO", help="explain the last failed requests of a client, to a unit, or on a line")
    add(
        "-n",
        "--count",
        type=count,
        metavar="COUNT",
        help=f"the next so many requests; with --since the last ones; with --why, failures (default {_STORIES})",
    )
    add("--pcapng", metavar="FILE", help="write a capture file for Wireshark; - is standard output")
    add("--json", action="store_true", help="print JSON, an object on each line, instead of rows")
    add_control_argument(parser)
    let_options_stand_anywhere(parser)


def run(args: argparse.Namespace) -> int:
    """Show what passes until Ctrl-C, or what has passed; 1 when there is no story to tell."""
    _refuse_what_does_not_fit(args)
    with Conversation(which_gateway(args)) as daemon:
        if args.why is not None:
            return _tell_why(daemon, args)
        if args.pcapng is not None:
            return _capture(daemon, args)
        return _show(daemon, args)


def _refuse_what_does_not_fit(args: argparse.Namespace) -> None:
    if args.why is not None and args.pcapng is not None:
        raise WrongUsageError("--why prints text, and a capture file has only frames", "leave one of them out")
    if args.why is not None and (args.unit is not None or args.since is not None):
        remedy = f"modbus-gateway trace --why {args.why}"
        raise WrongUsageError("--why finds the last failures by itself; --unit and --since are for frames", remedy)
    if args.why is not None and args.count is not None and args.count > MOST_STORIES:
        raise WrongUsageError(f"-n {args.count} is too many for --why", f"-n {MOST_STORIES} at most")
    if args.pcapng is not None and args.json:
        raise WrongUsageError("--pcapng and --json are two forms", "leave one of them out")
    if args.pcapng == "-" and sys.stdout.isatty():
        raise WrongUsageError(
            "a capture file is not for a terminal", "modbus-gateway trace --pcapng - | wireshark -k -i -"
        )


def _tell_why(daemon: Conversation, args: argparse.Namespace) -> int:
    answer = daemon.ask(WHY, ToExplain(args.why, args.count or _STORIES, args.line))
    stories = answer.stories
    if args.json:
        for story in stories:
            print(json.dumps(story, ensure_ascii=False))
    elif stories:
        width = shutil.get_terminal_size().columns
        print("\n\n".join(told(story, width) for story in reversed(stories)))
    if stories:
        return FINE
    clients = answer.clients_that_failed
    others = (
        f"; requests of these clients failed: {', '.join(clients)}"
        if clients
        else "; no other request has failed either"
    )
    print(f"no failed request of or to {args.why} is in memory{others}", file=sys.stderr)
    return PROBLEM_FOUND


def _show(daemon: Conversation, args: argparse.Namespace) -> int:
    follower = _Follower(daemon, args)
    widths = (max([len(name) for name in follower.modes], default=0), 3)
    for fact in follower.facts(args.since):
        if args.json:
            print(json.dumps(fact, ensure_ascii=False), flush=True)
        else:
            for row in rows(fact):
                print(row.show(widths), flush=True)
    return FINE


def _capture(daemon: Conversation, args: argparse.Namespace) -> int:
    """Write frames as they come; without --since what the ring has first, and then until Ctrl-C."""
    follower = _Follower(daemon, args)
    writer, written = Writer(f"modbus-gateway {__version__}"), 0
    with ExitStack() as stack:
        file: BinaryIO = sys.stdout.buffer if args.pcapng == "-" else stack.enter_context(_created(args.pcapng))
        stack.callback(lambda: print(f"{written} frames written", file=sys.stderr))
        file.write(writer.head())
        file.flush()
        for fact in follower.facts(args.since, from_the_beginning=True):
            for packet in packets(fact, follower.modes):
                file.write(writer.interface(packet.line, follower.descriptions[packet.line]))
                file.write(writer.packet(packet))
                written += 1
            file.flush()
    return FINE


def _created(path: str) -> BinaryIO:
    try:
        return Path(path).open("wb")
    except OSError as error:
        raise DaemonError(f"{path} cannot be written: {error.strerror}") from error


class _Follower:
    """Asks the gateway again and again for what is new; `modes` and `descriptions` are those of its lines."""

    def __init__(self, daemon: Conversation, args: argparse.Namespace) -> None:
        self._daemon = daemon
        self._chosen = Traced(line=args.line, unit=args.unit, points=args.pcapng is None)
        self._count: int | None = args.count
        lines = daemon.ask(TRACE, replace(self._chosen, after=0, lines=True)).lines
        self.modes = {line.name: line.mode for line in lines}
        self.descriptions = {line.name: description(line) for line in lines}

    def facts(self, since: float | None, *, from_the_beginning: bool = False) -> Iterator[Fact]:
        """Give those of the last `since` seconds and no more, or the last ones of these.

        Without `since` the last few, and then until Ctrl-C; or the next ones.
        """
        if since is not None:
            found = list(self._pages(since, is_live=False))
            yield from found if self._count is None else found[-self._count :]
            return
        begin = _ALWAYS if from_the_beginning else None if self._count is None else 0.0
        facts = self._pages(begin, is_live=True)
        for number, fact in enumerate(facts, 1):
            yield fact
            if number == self._count:
                return

    def _pages(self, since: float | None, *, is_live: bool) -> Iterator[Fact]:
        asked = replace(self._chosen, since=since)
        while True:
            page = self._daemon.ask(TRACE, asked)
            if asked.since is not None and not is_live and page.reaches_back_s < asked.since:
                print(f"the records in memory go back {page.reaches_back_s:.0f} s only", file=sys.stderr)
            elif page.missed:
                print(f"{page.missed} records were gone before they could be fetched", file=sys.stderr)
            yield from page.facts
            asked = replace(self._chosen, after=page.next)
            if page.is_all:
                if not is_live:
                    return
                time.sleep(_STEP)
