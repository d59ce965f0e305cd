"""Facts of the ring as frames on a line, and as packets of a capture file."""

from collections.abc import Iterator, Mapping
from functools import partial
from typing import Any, Final

from gateway.modbus import mbap, rtu
from gateway.modbus.ascii import END, START
from gateway.modbus.rtu import with_crc
from gateway.modbus.scan_ascii import AsciiScanner
from gateway.modbus.scan_rtu import RtuScanner
from gateway.operator.operations.answers.trace import TracedLine
from gateway.trace.pcapng import Dissector, Packet

#: What is heard of others that is a request.
_REQUESTS: Final = ("another's request", "an echo")

Fact = Mapping[str, Any]


def packets(fact: Fact, modes: Mapping[str, str]) -> Iterator[Packet]:
    """Yield the frames of one fact, oldest first. `modes` has the mode of each line: `rtu`, `ascii` or `tcp`."""
    mode = modes.get(fact["line"])
    if mode is None:
        return
    if fact["kind"] == "exchange":
        yield from _exchange(fact, mode)
    elif fact["kind"] == "heard":
        yield _heard(fact, mode)
    elif fact["kind"] == "answered":
        yield from _answered(fact)


def _dissector(mode: str) -> Dissector:
    return "mbtcp" if mode == "tcp" else "mbrtu"


def description(line: TracedLine) -> str:
    """Describe a line for its interface in a capture file."""
    if line.mode == "tcp":
        return f"Modbus TCP, {line.port}"
    as_rtu = ", shown as RTU" if line.mode == "ascii" else ""
    return f"{line.port}, {line.mode.upper()} {line.baud} {line.format}{as_rtu}"


def wire_frame(unit: int, pdu: bytes, mode: str) -> bytes:
    """Encode a frame for a capture file. Frames of ASCII lines become RTU, which has a dissector."""
    return mbap.encode(0, unit, pdu) if mode == "tcp" else rtu.encode(unit, pdu)


def count_frames(heard: bytes, mode: str) -> int:
    """Count the frames that came instead of a response; 0 if anything else came too, such as a damaged one."""
    if mode == "tcp":
        return 1
    scanner = AsciiScanner() if mode == "ascii" else RtuScanner()
    count = end = 0
    for token in sorted(scanner.received(heard, 0.0), key=lambda each: each.start):
        if token.start == end:
            count, end = count + 1, token.end
    return count if end == len(heard) else 0


def heard_frame(heard: bytes, mode: str) -> tuple[bytes, bool]:
    """Return what came instead of a response, as a capture file shows it, and whether its checksum is wrong."""
    if mode == "tcp":
        return heard, False
    if mode == "ascii":
        try:
            body = bytes.fromhex(heard.removeprefix(START).removesuffix(END).decode("ascii"))
        except ValueError:
            return heard, True
        is_sound = len(body) > 2 and sum(body) & 0xFF == 0
        frame = with_crc(body[:-1])
        return (frame, False) if is_sound else (frame[:-2] + bytes(each ^ 0xFF for each in frame[-2:]), True)
    return heard, len(heard) < 4 or with_crc(heard[:-2]) != heard


def _heard(fact: Fact, mode: str) -> Packet:
    data, owner = bytes.fromhex(fact["frame"]), fact["owner"]
    is_noise = owner == "noise"
    frame, is_request = data if is_noise else wire_frame(data[0], data[1:], mode), owner in _REQUESTS
    return Packet(fact["time"], fact["line"], frame, owner, is_request, False, is_noise, _dissector(mode))


def _exchange(fact: Fact, mode: str) -> Iterator[Packet]:
    line, address, dissector = fact["line"], fact["address"], _dissector(mode)
    received = partial(Packet, fact["time"], line, is_request=False, is_sent=False, dissector=dissector)
    limit, client = f"limit {fact['limit_ms']:.1f} ms", fact["client"]
    asked = wire_frame(address, bytes.fromhex(fact["request"]), mode)
    waited = f"for {client} as unit {fact['unit']}, waited {fact['wait_ms']:.1f} ms, {limit}"
    yield Packet(fact["sent"], line, asked, waited, is_request=True, is_sent=True, dissector=dissector)
    elapsed = f"{fact['elapsed_ms']:.1f} ms after the request, {limit}"
    if fact["response"] is not None:
        unit = fact.get("answered_by")
        answer = wire_frame(address if unit is None else unit, bytes.fromhex(fact["response"]), mode)
        yield received(answer, elapsed)
    elif fact.get("heard"):
        heard = bytes.fromhex(fact["heard"])
        if mode != "tcp" and count_frames(heard, mode):
            return  # each of them has a `heard` fact of its own
        frame, is_bad = heard_frame(heard, mode)
        what = "wrong check sum" if is_bad else "no response to the request"
        yield received(frame, f"{what}; {elapsed}", is_damaged=is_bad)


def _answered(fact: Fact) -> Iterator[Packet]:
    """Yield the frames of a request on a server line."""
    line, unit = fact["line"], fact["unit"]
    asked = rtu.encode(unit, bytes.fromhex(fact["request"]))
    yield Packet(fact["received"], line, asked, "", is_request=True, is_sent=False)
    if fact["response"] is not None:
        elapsed = f"{1000 * (fact['time'] - fact['received']):.1f} ms after the request"
        answer = rtu.encode(unit, bytes.fromhex(fact["response"]))
        yield Packet(fact["time"], line, answer, elapsed, is_request=False, is_sent=True)
