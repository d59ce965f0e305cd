"""`forget`: a device that changed its address or rate is asked where the config says again."""

import argparse
import json
from collections.abc import Iterator

from gateway.cli.kit.daemon import Conversation, add_control_argument, tell_which, which_gateway
from gateway.cli.kit.usage import number_or_name
from gateway.cli.main import FINE
from gateway.control.messages import result_in
from gateway.devices.moved import show_addresses
from gateway.operator.operations.answers.forget import Forgotten
from gateway.operator.operations.asked import OneDevice
from gateway.operator.operations.table import FORGET


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of `forget`."""
    parser.add_argument(
        "device", type=number_or_name, metavar="DEVICE", help="the device, by its name or its unit number"
    )
    add_control_argument(parser)
    parser.add_argument("--json", action="store_true", help="print JSON instead of text")


def run(args: argparse.Namespace) -> int:
    """Forget, and print where the device is asked now."""
    with Conversation(which_gateway(args)) as daemon:
        tell_which(daemon.gateway)
        answer = daemon.ask_for_json(FORGET, OneDevice(args.device))
        forgotten = result_in(FORGET, answer)
    if args.json:
        print(json.dumps({**answer, "through": str(daemon.gateway)}, indent=2, ensure_ascii=False))
    else:
        print(*_lines(forgotten), sep="\n")
    return FINE


def _lines(forgotten: Forgotten) -> Iterator[str]:
    device, line, unit = forgotten.device, forgotten.line, forgotten.unit
    if forgotten.was_at != (unit,):
        was_at = show_addresses(forgotten.was_at)
        before = f", no longer at {was_at}" if forgotten.was_at else "; it was not asked before"
        yield f"{device} is asked at {unit} on {line}{before}"
    else:
        yield f"no other address was remembered of {device}: it is asked at {unit}"
    if forgotten.was_baud != forgotten.baud:
        yield f"{line} has {forgotten.baud} baud again, no longer {forgotten.was_baud}"
