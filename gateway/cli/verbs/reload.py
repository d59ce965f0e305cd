"""`reload`: make the running gateway read its config again."""

import argparse
import json
from collections.abc import Iterator
from typing import Final

from gateway.cli.kit.daemon import Conversation, add_control_argument, tell_which, which_gateway
from gateway.cli.kit.progress import working
from gateway.cli.main import FINE, PROBLEM_FOUND
from gateway.control.messages import result_in
from gateway.operator.operations.answers.running import Reloaded
from gateway.operator.operations.operation import Nothing
from gateway.operator.operations.table import RELOAD

#: What is said of tables that were added, removed or changed, or need a restart.
_CHANGES: Final = ("new", "gone", "changed", "takes effect after a restart")


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of `reload`."""
    add_control_argument(parser)
    parser.add_argument("--json", action="store_true", help="print JSON instead of text")


def run(args: argparse.Namespace) -> int:
    """Reload, and print what has changed; 1 if the file was rejected or an error occurred."""
    with Conversation(which_gateway(args)) as daemon:
        tell_which(daemon.gateway)
        with working("the gateway reads its config"):
            answer = daemon.ask_for_json(RELOAD, Nothing())
        reloaded = result_in(RELOAD, answer)
    if args.json:
        print(json.dumps({**answer, "through": str(daemon.gateway)}, indent=2, ensure_ascii=False))
    else:
        print(*_lines(reloaded), sep="\n")
    return FINE if reloaded.ok else PROBLEM_FOUND


def _lines(reloaded: Reloaded) -> Iterator[str]:
    if reloaded.problems:
        yield from reloaded.problems
        yield "the file was rejected; the running config is unchanged"
        return
    changes = (reloaded.added, reloaded.removed, reloaded.changed, reloaded.restart)
    if any(changes):
        yield from (f"{said}: {', '.join(names)}" for said, names in zip(_CHANGES, changes, strict=True) if names)
    else:
        yield f"nothing has changed in {reloaded.file}" if reloaded.file else "nothing has changed"
    yield from reloaded.warnings
    if reloaded.defect:
        yield f"{reloaded.defect}; the new config is in use"
