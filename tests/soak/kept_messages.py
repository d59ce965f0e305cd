"""Reads the values in messages of a gateway, plain and Sparkplug, without the gateway's own code."""

import json
from collections.abc import Iterator
from datetime import datetime
from typing import Any, NamedTuple

from soak.kept_record import Entry, Told
from soak.kept_tap import Packet, varint

SITE, GROUP = "soak", "group"


class Heard(NamedTuple):
    """A message as the subscriber got it."""

    at: float
    topic: str
    payload: bytes


def told_by(heard: Heard | Packet, *, is_sparkplug: bool, **more: Any) -> Told | None:
    """The values in a message; None if it has no values of a device."""
    levels = heard.topic.split("/")
    if is_sparkplug:
        if levels[0] != "spBv1.0" or levels[2] not in ("DBIRTH", "DDATA"):
            return None
        return _sparkplug(heard, levels[4], more)
    if levels[:2] != ["modbus", SITE] or len(levels) not in (3, 4) or not heard.payload:
        return None
    is_history = len(levels) == 4 and levels[3] == "history"
    if levels[2] == "status" or (len(levels) == 4 and not is_history):
        return None
    content = json.loads(heard.payload)
    entries = tuple(map(_entry, content if is_history else [content]))
    return Told(heard.at, levels[2], is_history, entries, shares_time=not is_history, **more)


def _entry(told: dict[str, Any]) -> Entry:
    values = {name: value for name, value in told.items() if name not in ("time", "clock")}
    return Entry(datetime.fromisoformat(told["time"]).timestamp(), values, told.get("clock") == "unsure")


def _sparkplug(heard: Heard | Packet, device: str, more: dict[str, Any]) -> Told:
    """Its metrics: names, times, whole values, and whether they are historical."""
    entries, kinds = [], set()
    for field, body in _fields(heard.payload):
        if field != 2:
            continue
        metric = dict(_fields(body))
        kinds.add(bool(metric.get(5)))
        value = metric.get(10, metric.get(11))
        if value is not None:
            entries.append(Entry(metric[3] / 1000, {metric[1].decode(): value}))
    assert len(kinds) < 2, "history and live values in one message"
    return Told(heard.at, device, kinds == {True}, tuple(entries), **more)


def _fields(data: bytes) -> Iterator[tuple[int, Any]]:
    """Number and value of each field of a message of Protocol Buffers."""
    at = 0
    while at < len(data):
        key, at = varint(data, at)
        match key & 7:
            case 0:
                value, at = varint(data, at)
                yield key >> 3, value
            case 2:
                size, at = varint(data, at)
                yield key >> 3, data[at : at + size]
                at += size
            case kind:
                at += {1: 8, 5: 4}[kind]
