"""Counts of a server line, where an outside client sends requests."""

from dataclasses import dataclass


@dataclass(slots=True)
class ServerCounts:
    """Events on a server line since it was created.

    Each of the `requests` to its units gets a response (some are `exceptions`) or not: the request has none, the
    failure was kept `silent`, the response came `too_late`, or it was `overtaken` by other bytes on the line.
    """

    requests: int = 0
    responses: int = 0
    exceptions: int = 0
    silent: int = 0
    too_late: int = 0
    overtaken: int = 0
    broadcasts: int = 0
    foreign_frames: int = 0
    noise: int = 0
    echoes: int = 0
