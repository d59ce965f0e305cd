"""`reload`: make the running gateway read its config again."""

import argparse
import json
from typing import Any

from gateway.cli.kit.daemon import UNKNOWN, Conversation, add_control_argument, tell_which, which_gateway
from gateway.cli.main import FINE, PROBLEM_FOUND

_CHANGES = {
    "added": "new",
    "removed": "gone",
    "changed": "changed",
    "restart": "takes effect after a restart",
}


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """The arguments of `reload`."""
    add_control_argument(parser)
    parser.add_argument("--json", action="store_true", help="print JSON instead of text")


def run(args: argparse.Namespace) -> int:
    """Reload, and print what has changed; 1 if the file was rejected or an error occurred.

    Raises:
        DaemonError: no gateway answers.
    """
    with Conversation(which_gateway(args)) as daemon:
        tell_which(daemon.gateway)
        answer = {**daemon.ask("reload"), "through": str(daemon.gateway)}
    if args.json:
        print(json.dumps(answer, indent=2, ensure_ascii=False))
    else:
        print(*_lines(answer), sep="\n")
    return FINE if answer.get("ok") is True else PROBLEM_FOUND


def _lines(answer: dict[str, Any]) -> list[str]:
    if problems := _told(answer, "problems"):
        return [*problems, "the file was rejected; the running config is unchanged"]
    changes = [
        f"{said}: {', '.join(told)}" for what, said in _CHANGES.items() if (told := _told(answer, what, UNKNOWN))
    ]
    defect = [f"{answer['defect']}; the new config is in use"] if answer.get("defect") else []
    nothing = f"nothing has changed in {answer['file']}" if answer.get("file") else "nothing has changed"
    return [*(changes or [nothing]), *_told(answer, "warnings"), *defect]


def _told(answer: dict[str, Any], key: str, *otherwise: str) -> list[str]:
    """A list in the answer, or `otherwise` if a gateway of another version does not have it."""
    told = answer.get(key, otherwise)
    return [str(each) for each in told] if isinstance(told, (list, tuple)) else [UNKNOWN]
