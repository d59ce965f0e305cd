"""The subjects of a fleet. NATS permissions decide which site may use which.

| subject                            | published by | subscribed by | what it is                                     |
|------------------------------------|--------------|---------------|------------------------------------------------|
| `mbgw.OWNER.unit.N.from.SENDER`    | SENDER       | OWNER         | a request PDU for unit N                       |
| `mbgw.SENDER.answer.OWNER.TOKEN`   | OWNER        | SENDER        | its response PDU                               |
| `mbgw.SITE.clock`                  | SITE         | everybody     | a heartbeat with the time of SITE's clock      |

The server does not check the reply subject of a message, so the owner does.
"""

import re
from typing import Final, NamedTuple

from gateway.modbus.codes import HIGHEST_UNIT

#: The bucket in which each site says how it is, and that of the leases of lines.
STATUS: Final = "mbgw-status"
LEASES: Final = "mbgw-lease"
#: The queue group of one site's gateways: each request goes to one of them.
GROUP: Final = "mbgw"

_REQUEST = re.compile(r"mbgw\.([A-Za-z0-9_-]+)\.unit\.([0-9]{1,3})\.from\.([A-Za-z0-9_-]+)")


class Asked(NamedTuple):
    """A unit, and the site that sends the request."""

    unit: int
    sender: str


def request_subject(owner: str, unit: int, sender: str) -> str:
    """Return the subject of requests to a unit; `*` as the sender matches all senders."""
    return f"mbgw.{owner}.unit.{unit}.from.{sender}"


def asked_by(subject: str, owner: str) -> Asked | None:
    """Parse the subject of a request; None if it is not a request to this owner."""
    match = _REQUEST.fullmatch(subject)
    if match is None or match[1] != owner or int(match[2]) > HIGHEST_UNIT:
        return None
    return Asked(int(match[2]), match[3])


def answer_folder(sender: str, owner: str) -> str:
    """Return the prefix of the subjects at which `sender` awaits answers of `owner`."""
    return f"mbgw.{sender}.answer.{owner}."


def all_answers(sender: str) -> str:
    """Return the subject that matches all answers to `sender`."""
    return f"mbgw.{sender}.answer.>"


def clock_subject(site: str) -> str:
    """Return the subject of a site's heartbeats."""
    return f"mbgw.{site}.clock"
