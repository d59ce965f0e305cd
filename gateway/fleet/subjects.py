"""The subjects of a fleet. The permissions of NATS say which site may use which of them.

| subject                            | published by | subscribed by | what it is                                     |
|------------------------------------|--------------|---------------|------------------------------------------------|
| `mbgw.OWNER.unit.N.from.SENDER`    | SENDER       | OWNER         | a request PDU for unit N                       |
| `mbgw.SENDER.answer.OWNER.TOKEN`   | OWNER        | SENDER        | its response PDU                               |
| `mbgw.SITE.clock`                  | SITE         | everybody     | SITE is there, and what its clock shows        |

The server looks at the subject of a message and not at its reply subject, so the owner looks at that.
"""

import re
from typing import Final, NamedTuple

#: The group of the gateways of one site: one of them gets each request.
GROUP: Final = "mbgw"

_REQUEST = re.compile(r"mbgw\.([A-Za-z0-9_-]+)\.unit\.([0-9]{1,3})\.from\.([A-Za-z0-9_-]+)")


class Asked(NamedTuple):
    """A unit, and the site that asks it."""

    unit: int
    sender: str


def request_subject(owner: str, unit: int, sender: str) -> str:
    """Where a request for a unit goes; with `*` for the sender, where those of all of them come."""
    return f"mbgw.{owner}.unit.{unit}.from.{sender}"


def asked_by(subject: str, owner: str) -> Asked | None:
    """What a request's subject says; None if it is not that of a request to this owner."""
    match = _REQUEST.fullmatch(subject)
    if match is None or match[1] != owner:
        return None
    return Asked(int(match[2]), match[3])


def answer_folder(sender: str, owner: str) -> str:
    """How the subjects begin at which a sender awaits the answers of an owner."""
    return f"mbgw.{sender}.answer.{owner}."


def all_answers(sender: str) -> str:
    """Where all answers to a sender come."""
    return f"mbgw.{sender}.answer.>"


def clock_subject(site: str) -> str:
    """Where a site tells what its clock shows."""
    return f"mbgw.{site}.clock"
