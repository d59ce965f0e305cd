"""Plays conversations on one line, in virtual time: see `conversation` for how they are written.

    # a late answer is nobody's
    line: mode = rtu or ascii, late_window = 1 s
    unit 2: timeout = 2 s
    client >> 01 03 00 10 00 01
    line   >> [01 03 00 10 00 01]
    client << 01 83 0B
    line   << 55 half [01 03 02 01 10]
    wait 20 ms
    line   << rest [01 03 02 01 10]
    event LateResponse unit 1, function 3
    counts unit 1: late_responses 1

`[..]` is the frame of this unit and PDU, in the line's mode with its check; before it, `half` and `rest` cut it in two,
`to 3` and `from 3` behind its third byte, `wrong` damages its check, `lower` writes it in small letters, and `marked`
sets the highest bit of each byte. Bytes outside of brackets are as they are, `55 x 600` is so many. Each `line <<` is
one read. What no step has shown when a conversation ends, a frame or an answer, fails it.

| step                             | meaning                                                                      |
|----------------------------------|------------------------------------------------------------------------------|
| `panel >> 01 03 00 10 00 01`     | a client of any name asks; each has an address of its own                    |
| `panel then 01 03 00 10 00 01`   | it asks this as soon as it gets its next answer, out of that                 |
| `panel << 01 83 0B at once`      | it gets this without any time passing. `line >> .. at once`: the same        |
| `panel << nothing`               | its request is over without an answer: a broadcast                           |
| `panel silent`, `panel leaves`   | it has got nothing else; it disconnects                                      |
| `scan >> 09 03 00 00 00 01`      | a scan asks in the line's idle time; `scan <<` is what it gets in time       |
| `scan hears 09 03 02 00 07`      | the scan is told of this answer, in time or late                             |
| `scan failed timeout`            | why the first question failed                                                |
| `line << damaged 01 03`          | a character of these bytes had a parity or framing error                     |
| `line silent`                    | nothing else was put on the line                                             |
| `line woken x 40`                | it is woken so often, though it does not want to be                          |
| `line finishes`                  | the gateway ends: the line takes no more requests                            |
| `wait 20 ms`                     | time passes, and the line is woken when it wants to be                       |
| `busy 20 ms`                     | time passes, and nobody wakes the line: the machine is busy                  |
| `port lost`, `port back`         | the port is lost, or open (again)                                            |
| `port ends`, `port ends early`   | the server closes its connection in order; early: as soon as it was opened   |
| `port wanted`, `port not wanted` | the line has it opened again since then, or not                              |
| `port renewed`, `port kept`      | the line closes its connection itself, for a new one, or needs not to        |
| `port stuck`, `port flows`       | what is written has not arrived at the other end of the connection; it has   |
| `reload`, `restart`              | another line takes over the port and what is open, from memory or by file    |
| `event LateResponse unit 1`      | the next event of this name has these fields; `advice has echo`: as part     |
| `no event LateResponse`          | no further event of this name; `no event`: none at all                       |
| `counts: timeout 1`              | the sum over all units; `counts unit 1: ..` of one; `counts line: ..`        |
| `unit 1 rests`, `unit 1 awake`   | whether it rests                                                             |
| `unit 1 moving`, `.. settled`    | whether it may still change its address, so that it cannot be forgotten      |

Settings of `line:` are `mode` (`rtu`: 19200 baud, `ascii`: 9600), `baud`, those of the config (`retries`, `echo`,
`gap`, ..), `shared` (another gateway asks here in turn: `counts line: askers` is how often it was told of a third
one), and `port`: `virtual` (default), `serial`, whose bytes take their time, or `connection`. Those of `unit 1:` are
`timeout` (200 ms by default), `urgent`, `answers_03` (what calibration says of function 03), `moves` and
`changes_baud`; a unit 0 with settings, `unit 0: alone = true`, is one device asked at address 0. Those of `scan:` are
`awaits_second` and `patience`.

A time limit is `timeout`, the answer on the wire, and 5 ms: 209.0 ms after the request for a read of one register,
which takes 4.6 ms (8 characters); its late window is twice as long. In ASCII 220.6 ms and 17.7 ms.
"""

import re
from collections.abc import Callable, Mapping
from dataclasses import replace
from functools import partial

from gateway.devices.scanned import ScannedUnit

from gateway.devices.addresses import UnitAddresses
from gateway.devices.device import Device
from gateway.devices.quirks import AddressZeroDevice, MovableDevice
from gateway.events import Event
from gateway.lines.counts import Counts, total
from gateway.lines.transaction import ScanTransaction
from gateway.modbus.frame import Frame
from gateway.modbus.pdu import parse_request
from gateway.profiles.profile import Profile
from gateway.request import Request
from gateway.timing.budget import AnswerTime
from gateway.timing.table import Point, TimingTable
from kit.asker import Asker
from kit.conversation import Conversation, seconds
from kit.line_bench import ASCII, TIMING, Bench

#: How long a step waits for what it shows, in seconds.
_PATIENCE = 120.0
_PART = re.compile(r"(?:(half|rest|wrong|lower|marked|(?:to|from) \d+) )?\[([0-9A-F ]+)\]|([0-9A-F]{2})(?: x (\d+))?")

Setting = str | float | bool


class NamedClient(Asker):
    """An Asker whose answers have their unit, and are `nothing` where a request ended without one.

    One that has left gets no answer. `next` is asked out of its next answer.
    """

    next: Callable[[], None] | None = None

    def answer(self, request: Request, pdu: bytes | None) -> None:
        if self.next is not None:
            ask, self.next = self.next, None
            ask()
        if not self.gone:
            self.answers.append("nothing" if pdu is None else f"{request.unit:02X} {pdu.hex(' ').upper()}")


class DeviceLine:
    """The line as its devices see it."""

    def __init__(self, bench: Bench) -> None:
        self.submit = bench.line.submit
        self._bench = bench

    def change_rate(self, baud: int) -> None:
        self._bench.line.change_rate(baud, self._bench.now)


class LineStage:
    """One line, its clients, and what each step does to them."""

    def __init__(self, conversation: Conversation) -> None:
        self._conversation = conversation
        self._settings: dict[str, dict[str, Setting]] = {}
        for each in conversation.settings:
            part, _, text = each.partition(": ")
            self._settings.setdefault(part, {}).update(_read_settings(text))
        self._clients: dict[str, NamedClient] = {}
        self._heard: list[tuple[Frame, float]] = []
        self._questions: list[Request] = []
        self._opened = 0
        self._askers = 0
        self._seen: list[Event] = []
        self._bench = self._new_bench()

    def play(self) -> None:
        """Play all steps."""
        for step in self._conversation.steps:
            at = self._bench.now
            try:
                self._play(step)
            except Exception as error:
                error.add_note(f"in `{step}`, at {1000 * (at - 101.0):.2f} ms, of: {self._conversation.title}")
                raise
        self._nothing_is_left()

    def _play(self, step: str) -> None:
        who, _, rest = step.partition(" ")
        rest = rest.strip()
        match who:
            case "wait":
                self._bench.pass_time(seconds(rest))
            case "busy":
                self._bench.now += seconds(rest)
            case "line":
                self._line(rest)
            case "port":
                self._port(rest)
            case "event":
                self._event(rest)
            case "no":
                self._no_event(rest.removeprefix("event").strip())
            case "counts" | "counts:":
                self._count(step)
            case "unit":
                unit, word = rest.split()
                assert self._unit_is(self._bench.devices[int(unit)], word)
            case "reload" | "restart":
                self._hand_over(by_file=who == "restart")
            case _:
                self._client(who, rest)

    def _unit_is(self, device: Device, word: str) -> bool:
        now = self._bench.now
        is_moving = self._bench.line.changes_until(device.possible_units, now) > now
        is_resting = device.is_resting(now)
        return {"rests": is_resting, "awake": not is_resting, "moving": is_moving, "settled": not is_moving}[word]

    def _client(self, name: str, rest: str) -> None:
        client = self._clients.setdefault(name, NamedClient(f"{name}:1", host=name))
        what, _, text = rest.partition(" ")
        match what:
            case ">>":
                self._ask(client, text)
            case "<<":
                self._await(text, lambda: client.answers)
                assert client.answers.pop(0) == text.removesuffix(" at once")
            case "then":
                client.next = partial(self._ask, client, text)
            case "silent":
                assert client.answers == []
            case "leaves":
                client.gone = True
            case "hears":
                frame, _ = self._heard.pop(0)
                assert f"{frame.unit:02X} {frame.pdu.hex(' ').upper()}" == text
            case "failed":
                assert next(each.error.result for each in self._questions if each.error is not None) == text
            case _:
                raise ValueError(rest)

    def _ask(self, client: NamedClient, text: str) -> None:
        unit, pdu = int(text[:2], 16), text[3:]
        if client.client == "scan:1":
            self._scan(client, unit, pdu)
        elif unit == 0 and unit not in self._bench.devices:
            self._bench.broadcast(pdu, client)
        else:
            self._bench.ask(pdu, unit, client)

    def _scan(self, client: NamedClient, unit: int, pdu: str) -> None:
        settings = {"awaits_second": True, "patience": 0.0} | self._settings.get("scan", {})
        request = client.ask(pdu, unit=unit, now=self._bench.now)
        self._questions.append(request)
        asked = ScannedUnit(unit, AnswerTime(TimingTable(), margin=1.0, timeout=0.2), lambda: self._bench.now)
        asked.heard = self._heard
        self._bench.line.submit(
            ScanTransaction(request, parse_request(request.pdu), asked, **settings), self._bench.now
        )

    def _line(self, rest: str) -> None:
        what, _, text = rest.partition(" ")
        bench = self._bench
        match what:
            case ">>":
                self._await(text, lambda: bench.written)
                assert bench.written.pop(0) == self._bytes(text.removesuffix(" at once")).hex(" ").upper()
            case "<<":
                data = self._bytes(text.removeprefix("damaged "))
                bench.line.received(data, bench.now, damaged=text.startswith("damaged "))
            case "silent":
                assert bench.written == []
            case "woken":
                for _ in range(int(text.removeprefix("x "))):
                    bench.line.tick(bench.now)
            case "finishes":
                bench.line.finish(bench.now)
            case _:
                raise ValueError(rest)

    def _port(self, what: str) -> None:
        bench = self._bench
        match what:
            case "lost":
                bench.unplug()
            case "back":
                bench.plug()
            case "ends" | "ends early":
                self._opened = 0
                bench.line.port_ended(self._open_again, bench.now, at_once=what == "ends early")
            case "wanted" | "not wanted":
                assert self._opened == (what == "wanted")
            case "renewed":
                assert bench.line.must_renew(bench.now)
                bench.line.renew(bench.now)
                bench.line.port_ended(self._open_again, bench.now)
            case "kept":
                assert not bench.line.must_renew(bench.now)
            case "stuck" | "flows":
                bench.arrives = what == "flows"
            case _:
                raise ValueError(what)

    def _open_again(self) -> None:
        self._opened += 1

    def _event(self, text: str) -> None:
        name, _, fields = text.partition(" ")
        told = next((event for event in self._unseen() if type(event).__name__ == name), None)
        assert told is not None, self._bench.events
        self._seen.append(told)
        for field in fields.split(", ") if fields else ():
            key, _, value = field.partition(" ")
            shown = str(getattr(told, key))
            if value.startswith("has "):
                assert value.removeprefix("has ") in shown
            else:
                assert (key, shown) == (key, value)

    def _no_event(self, name: str) -> None:
        assert [event for event in self._unseen() if name in ("", type(event).__name__)] == []

    def _unseen(self) -> list[Event]:
        return [event for event in self._bench.events if not any(event is seen for seen in self._seen)]

    def _count(self, step: str) -> None:
        whose, _, text = step.partition(": ")
        numbers = [each.split() for each in text.split(", ")]
        counts = self._counts(whose.removeprefix("counts").strip())
        assert {name: counts(name) for name, _ in numbers} == {name: int(number) for name, number in numbers}

    def _counts(self, whose: str) -> Callable[[str], int]:
        line, now = self._bench.line, self._bench.now
        if whose != "line":
            counts: Counts = self._bench.counts
            if whose:
                of_unit = self._bench.devices[int(whose.removeprefix("unit "))].counts
                counts = total(of_unit.values())
                kept = {
                    "instead": len(of_unit.received_instead),
                    "late": sum(each.late for each in of_unit.times.values()),
                }
            return lambda name: kept[name] if whose and name in kept else getattr(counts, name)
        others = line.overheard
        return {
            "waiting": line.waiting,
            "late_windows": line.late_windows(now),
            "unasked_bytes": line.unasked_bytes,
            "askers": self._askers,
            "copies_in_a_row": line.copies_in_a_row,
            "copies": others.copies,
            "requests": others.requests,
            "second_responses": sum(others.second_responses.values()),
            "belated": sum(each.count for each in others.belated.values()),
        }.__getitem__

    def _await(self, text: str, seen: Callable[[], object]) -> None:
        """Let time pass until something is seen."""
        bench = self._bench
        end = bench.now if text.endswith(" at once") else bench.now + _PATIENCE
        while not seen():
            deadline = bench.line.deadline()
            assert deadline is not None, "the line waits for nothing"
            assert deadline <= end, "it does not come"
            assert not bench.line.must_renew(bench.now), "the line waits for a new connection"
            bench.now = max(deadline, bench.now)
            bench.line.tick(bench.now)

    def _hand_over(self, *, by_file: bool) -> None:
        before = self._bench
        before.unplug()
        self._nothing_is_written(before)
        self._bench = self._new_bench()
        self._bench.take_over(before, by_file=by_file)
        self._bench.events[:0] = before.events

    def _nothing_is_left(self) -> None:
        """Check that the conversation has shown all frames and answers."""
        self._nothing_is_written(self._bench)
        assert {name: client.answers for name, client in self._clients.items() if client.answers} == {}
        assert self._heard == []

    def _nothing_is_written(self, bench: Bench) -> None:
        assert bench.written == [], "the conversation does not show that"

    # --- what it is played on ---

    def _new_bench(self) -> Bench:
        settings = dict(self._settings.get("line", {}))
        timing = ASCII if settings.pop("mode", "rtu") == "ascii" else TIMING
        timing = replace(timing, baud=int(settings.pop("baud", timing.baud)))
        port, shared = settings.pop("port", "virtual"), settings.pop("shared", False)
        bench = Bench(virtual=port != "serial", connection=port == "connection", timing=timing, **settings)
        if shared:
            bench.line.share(lambda: True, self._heard_asker)
        for part, values in self._settings.items():
            if part.startswith("unit "):
                self._add_device(bench, int(part.removeprefix("unit ")), dict(values))
        return bench

    def _heard_asker(self) -> None:
        self._askers += 1

    def _add_device(self, bench: Bench, unit: int, settings: dict[str, Setting]) -> None:
        settings.pop("alone", None)
        quirks = frozenset(quirk for quirk in ("moves", "changes_baud") if settings.pop(quirk, False))
        profile = Profile("weigher", quirks=quirks) if quirks else None
        points = {int(key[-2:]): [Point(1, value)] for key, value in settings.items() if key.startswith("answers_")}
        timeout, urgent = settings.pop("timeout", 0.2), settings.pop("urgent", False)
        device = bench.device(unit, profile, timeout, urgent=urgent)
        assert all(key.startswith("answers_") for key in settings), settings
        if points:
            device.answer_time = AnswerTime(TimingTable.of(points), margin=1.5, timeout=timeout)
        if quirks:
            bench.devices[unit] = self._movable(bench, device)
        elif unit == 0:
            bench.devices[unit] = AddressZeroDevice(device.settings, bench.line)

    def _movable(self, bench: Bench, device: Device) -> MovableDevice:
        return MovableDevice(
            device.settings, DeviceLine(bench), line_name="hall-a", line_source="", addresses=UnitAddresses(),
            is_alone=True, remember=lambda *_: None, emit=bench.events.append,
        )  # fmt: skip

    def _bytes(self, text: str) -> bytes:
        """Read what is on the line."""
        parts = list(_PART.finditer(text))
        assert " ".join(part.group() for part in parts) == text, f"not understood: {text}"
        return b"".join(map(self._part, parts))

    def _part(self, part: re.Match[str]) -> bytes:
        how, frame, byte, times = part.groups()
        if byte:
            return bytes.fromhex(byte) * int(times or 1)
        whole = bytes.fromhex(self._bench.frame(int(frame[:2], 16), frame[3:]))
        word, _, at = (how or "as it is").partition(" ")
        return _SHAPES[word](whole, int(at) if at.isdigit() else len(whole) // 2)


def _with_wrong_check(whole: bytes, _: int) -> bytes:
    if not whole.endswith(b"\r\n"):
        return whole[:-1] + bytes((whole[-1] ^ 1,))
    digit = b"1" if whole[-3:-2] == b"0" else b"0"
    return whole[:-3] + digit + whole[-2:]


_SHAPES: Mapping[str, Callable[[bytes, int], bytes]] = {
    "as": lambda whole, _: whole,
    "half": lambda whole, at: whole[:at],
    "to": lambda whole, at: whole[:at],
    "rest": lambda whole, at: whole[at:],
    "from": lambda whole, at: whole[at:],
    "wrong": _with_wrong_check,
    "lower": lambda whole, _: whole.lower(),
    "marked": lambda whole, _: bytes(byte | 0x80 for byte in whole),
}


def _read_settings(text: str) -> dict[str, Setting]:
    pairs = (each.split(" = ") for each in text.split(", "))
    return {key: _value(value) for key, value in pairs}


def _value(text: str) -> Setting:
    if text in ("true", "false"):
        return text == "true"
    if re.fullmatch(r"[\d.]+ m?s", text):
        return seconds(text)
    if re.fullmatch(r"\d+", text):
        return int(text)
    return float(text) if re.fullmatch(r"\d+\.\d+", text) else text
