"""The frames on a line that a request led to, from the ring."""

from gateway.modbus import ascii as ascii_framing
from gateway.modbus import mbap, rtu
from gateway.runtime.gateway import Gateway
from gateway.runtime.running import Running
from gateway.trace.records import Incident, Sent
from gateway.trace.ring import STEP, Ring


def frames_of(running: Running, client: str, pdu: bytes | None, received_at: float) -> dict[str, str]:
    """Find the frames `sent` and `received` for a client's request that has just ended, in hexadecimal; {} if none.

    Without `pdu`, those of the last of several requests that were made of one.
    """
    found = _exchange(running.ring, client, pdu, received_at)
    if found is None:
        return {}
    received = found.heard if isinstance(found, Incident) else b""
    if found.response is not None:
        by = found.answered_by if isinstance(found, Incident) else None
        received = _frame(running.gateway, found.line, found.address if by is None else by, found.response)
    sent = _frame(running.gateway, found.line, found.address, found.request)
    return {"sent": sent.hex(" ").upper(), "received": received.hex(" ").upper()}


def _exchange(ring: Ring, client: str, pdu: bytes | None, received_at: float) -> Sent | None:
    for record in reversed(ring.after(max(0, ring.added - STEP))):
        if isinstance(record, Sent) and pdu in (None, record.request):
            sharers = record.others if isinstance(record, Incident) else ()
            asked = ((record.client, record.received_at), *((who, at) for who, _, at in sharers))
            if (client, received_at) in asked:
                return record
    return None


def _frame(gateway: Gateway, line: str, unit: int, pdu: bytes) -> bytes:
    mode = next((each.plan.line.timing.mode for each in gateway.lines if each.name == line), None)
    if mode is None:
        return mbap.encode(0, unit, pdu)
    return ascii_framing.encode(unit, pdu) if mode == "ascii" else rtu.encode(unit, pdu)
