"""Rules about clients."""

from collections.abc import Iterator
from math import ceil
from typing import Final

from gateway.config.values.duration import show_duration
from gateway.diagnosis.evidence import ClientEvidence
from gateway.diagnosis.finding import Finding

#: A client that has left this often before its response does so regularly.
OFTEN: Final = 3
#: No client has a shorter time-out, in seconds: one that leaves sooner was stopped, as by Ctrl-C.
SHORTEST_TIME_OUT: Final = 0.1


def about_client(client: ClientEvidence) -> Iterator[Finding]:
    """Find a client whose time-out is shorter than its responses may take."""
    if client.left < OFTEN:
        return
    about = f"client {client.host} of {client.listener}"
    waited = show_duration(client.waited)
    what = (
        f"closed its connection {client.left} times before its response came, the last time after {waited}{client.last}"
    )
    if SHORTEST_TIME_OUT <= client.waited < client.longest_wait:
        longest = show_duration(ceil(client.longest_wait * 10) / 10)
        yield Finding(client.last.level, about, what, f"set the time-out of this client above {longest}")
    else:
        yield Finding("note", about, what)
