"""`forget`: a device that changed its address or rate is asked where the config says again."""

import argparse
import json
from collections.abc import Iterator, Mapping
from typing import Any

from gateway.cli.kit.daemon import Conversation, add_control_argument, tell_which, which_gateway
from gateway.cli.main import FINE
from gateway.devices.quirks import show_units


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of `forget`."""
    parser.add_argument("device", metavar="DEVICE", help="the device, by its name or its unit number")
    add_control_argument(parser)
    parser.add_argument("--json", action="store_true", help="print JSON instead of text")


def run(args: argparse.Namespace) -> int:
    """Forget, and print where the device is asked now.

    Raises:
        DaemonError: no gateway answers, or it refuses.
    """
    device = int(args.device) if args.device.isdecimal() else args.device
    with Conversation(which_gateway(args)) as daemon:
        tell_which(daemon.gateway)
        answer = {**daemon.ask("forget", device=device), "through": str(daemon.gateway)}
        if args.json:
            print(json.dumps(answer, indent=2, ensure_ascii=False))
        else:
            print(*_lines(answer["forgotten"]), sep="\n")
    return FINE


def _lines(forgotten: Mapping[str, Any]) -> Iterator[str]:
    unit, was_at = forgotten["unit"], tuple(forgotten["was_at"])
    if was_at != (unit,):
        before = f", no longer at {show_units(was_at)}" if was_at else "; it was not asked before"
        yield f"{forgotten['device']} is asked at {unit} on {forgotten['line']}{before}"
    else:
        yield f"no other address was remembered of {forgotten['device']}: it is asked at {unit}"
    if forgotten["was_baud"] != forgotten["baud"]:
        yield f"{forgotten['line']} has {forgotten['baud']} baud again, no longer {forgotten['was_baud']}"
