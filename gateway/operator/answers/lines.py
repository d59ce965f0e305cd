"""Lines, lines where the gateway is the server, and other servers."""

from dataclasses import dataclass

from gateway.operator.answers.status import LineStatus, ServerStatus, UpstreamStatus


@dataclass(frozen=True, slots=True)
class Lines:
    """All of them, in the order of the config."""

    lines: tuple[LineStatus, ...]
    servers: tuple[ServerStatus, ...]
    upstreams: tuple[UpstreamStatus, ...]
