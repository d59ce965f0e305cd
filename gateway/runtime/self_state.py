"""The values of the gateway's own unit."""

from typing import Final, Protocol

from gateway.images.self_image import SelfImage
from gateway.images.self_map import LAYOUT, LINES, SERVERS, UPSTREAMS, Shown, Values
from gateway.images.services import BUS_BUSY, BUS_MESSAGES, COMMUNICATION_ERRORS, NO_RESPONSES
from gateway.lines.counts import Counts, total, total_of_units
from gateway.modbus.codes import HIGHEST_UNIT
from gateway.ports.reconnector import Reconnector
from gateway.runtime.gateway import Gateway, Owner
from gateway.runtime.gateway_line import GatewayLine
from gateway.runtime.gateway_server import GatewayServer
from gateway.runtime.gateway_upstream import GatewayUpstream
from gateway.runtime.recent import Recent
from gateway.timing.measured import NEVER

_UP, _DOWN, _NOT_TRIED = 1, 2, 3
_UNKNOWN: Final = 0xFFFF
_NO_ANSWER_YET: Final = 0xFFFFFFFF


class Watched(Protocol):
    """A running gateway. `started` is a time of the loop's clock; `reload_succeeded`: the last config was accepted."""

    gateway: Gateway
    recent: Recent
    started: float
    reload_succeeded: bool


def show_itself(running: Watched) -> None:
    """Let the image of the gateway, if there is one, show how `running` is doing."""
    for image in running.gateway.images:
        if isinstance(image, SelfImage):
            image.look = lambda now: shown(running, now)


def shown(running: Watched, now: float) -> Shown:
    """Collect the values of the gateway's image."""
    gateway = running.gateway
    lines = tuple(_line(running, line, now) for line in gateway.lines)
    servers = tuple(map(_server, gateway.servers))
    upstreams = tuple(_upstream(each, now) for each in gateway.upstreams)
    counts = total(total_of_units(owner.counts) for owner in gateway.owners)
    failing = {unit for owner in gateway.owners for unit in _failing(owner, now)}
    down = [sum(part["state"] == _DOWN for part in parts) for parts in (lines, servers, upstreams)]
    is_deaf = any(_state(monitor.reconnector) == _DOWN for monitor in gateway.monitors)
    values: Values = {
        "layout": LAYOUT,
        "trouble": int(any(down) or is_deaf or bool(failing)),
        "uptime": int(now - running.started),
        "lines": len(lines),
        "lines-down": down[0],
        "server-lines": len(servers),
        "server-lines-down": down[1],
        "upstreams": len(upstreams),
        "upstreams-down": down[2],
        "units": sum(len(owner.all_devices) for owner in gateway.owners),
        "units-failing": len(failing),
        "clients": sum(listener.clients for listener in gateway.listeners),
        "reload-failed": int(not running.reload_succeeded),
        "loop-lag": int(1000 * running.recent.loop_lag),
        "answered": _answered(counts),
        "failed": _failed(counts),
    }
    counters = {
        BUS_MESSAGES: counts.sent + counts.responses,
        COMMUNICATION_ERRORS: counts.bad_frame,
        NO_RESPONSES: counts.timeout,
        BUS_BUSY: counts.queue_full + counts.expired,
    }
    blocks = {LINES.title: lines, SERVERS.title: servers, UPSTREAMS.title: upstreams}
    return Shown(values, blocks, [unit for unit in failing if unit <= HIGHEST_UNIT], counters)


def _line(running: Watched, line: GatewayLine, now: float) -> Values:
    counts, rate = total_of_units(line.counts), running.recent.rate(line, now)
    times = [each for device in line.devices.values() for each in device.counts.times.values()]
    answered_at = max((each.answered_at for each in times), default=NEVER)
    return {
        "state": _state(line.reconnector),
        "busy": _UNKNOWN if rate is None else round(1000 * rate.busy),
        "rate": _UNKNOWN if rate is None else round(10 * rate.per_second),
        "waiting": len(line.driver.line.queue),
        "units": len(line.devices),
        "units-failing": len(_failing(line, now)),
        "answered": _answered(counts),
        "exceptions": counts.exception,
        "timeouts": counts.timeout,
        "bad-frames": counts.bad_frame,
        "late": counts.late_responses,
        "line-down": counts.line_down + counts.line_lost,
        "refused-busy": counts.queue_full + counts.expired,
        "resting": counts.resting,
        "reopened": line.reconnector.reopened,
        "silent-for": _NO_ANSWER_YET if answered_at == NEVER else int(now - answered_at),
        "name": line.name,
    }


def _server(server: GatewayServer) -> Values:
    counts = server.driver.counts
    return {
        "state": _state(server.reconnector),
        "requests": counts.requests,
        "responses": counts.responses,
        "name": server.name,
    }


def _upstream(upstream: GatewayUpstream, now: float) -> Values:
    counts = total_of_units(upstream.counts)
    return {
        "state": _state(upstream.reconnector),
        "waiting": upstream.driver.upstream.waiting,
        "units": len(upstream.all_devices),
        "units-failing": len(_failing(upstream, now)),
        "answered": _answered(counts),
        "exceptions": counts.exception,
        "timeouts": counts.timeout,
        "reopened": upstream.reconnector.reopened,
        "name": upstream.name,
    }


def _state(reconnector: Reconnector) -> int:
    if not reconnector.tried.is_set():
        return _NOT_TRIED
    return _UP if reconnector.error is None else _DOWN


def _failing(owner: Owner, now: float) -> list[int]:
    """List the keys of units that failed to answer last time; while their line is down, all that were ever asked."""
    is_down = _state(owner.reconnector) == _DOWN
    return [
        device.settings.known_as
        for device in owner.all_devices
        if device.breaker.failures or device.breaker.is_resting(now) or (is_down and device.counts)
    ]


def _answered(counts: Counts) -> int:
    return counts.ok + counts.exception + counts.broadcast


def _failed(counts: Counts) -> int:
    """Count requests without an answer from a unit, except refusals by its profile and those no longer wanted."""
    not_sent = counts.line_down + counts.resting + counts.overdue + counts.echo_suspected
    not_sent += counts.queue_full + counts.expired
    return counts.timeout + counts.bad_frame + counts.ambiguous + counts.line_lost + not_sent
