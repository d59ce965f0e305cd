"""Client lines, server lines and upstreams."""

from dataclasses import dataclass

from gateway.operator.answers.status import LineStatus, ServerStatus, UpstreamStatus


@dataclass(frozen=True, slots=True)
class Lines:
    """All lines and upstreams, in the order of the config."""

    lines: tuple[LineStatus, ...]
    servers: tuple[ServerStatus, ...]
    upstreams: tuple[UpstreamStatus, ...]
