"""What pages call things that have a name of their own in the gateway: results, and owners of frames that were heard.

Other words of the gateway, as states, are their own English. `deploy/gateway_words.py` lists all that are translated.
"""

from collections.abc import Mapping
from typing import Final

#: Marks a text for `deploy/translations.py`, where it is no argument of `_()` or `word()` yet.
N_: Final = str

#: The English of a name.
ENGLISH: Final[Mapping[str, str]] = {
    "ambiguous": "ambiguous response",
    "bad_frame": "broken frame",
    "denied": "no right",
    "echo_suspected": "like an echo",
    "expired": "waited too long",
    "failed": "any failure",
    "fix": "to fix",
    "line_down": "line down",
    "line_lost": "port lost",
    "no_route": "no such unit",
    "only_heard": "only heard",
    "not_answered": "not answered",
    "overdue": "late response awaited",
    "queue_full": "queue full",
    "refused": "not allowed",
    "sent_again": "sent again",
    "timeout": "time-out",
    "unwanted": "client has left",
    "a damaged frame": "a character of it was damaged",
    "a late response": "late response to an earlier request",
    "an echo": "echo of a request",
    "another client": "response to another client",
    "another's request": "request of another client",
    "nobody": "not requested by anybody",
}
