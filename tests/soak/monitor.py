"""A monitor beside real clients and devices on one bus: no value that the device did not give to that request.

    .venv/bin/python tests/soak/monitor.py --transactions 1000000 --faults 2% --seed 1 --mode rtu
    .venv/bin/python tests/soak/monitor.py --transactions 100000 --faults 0
    .venv/bin/python tests/soak/monitor.py --transactions 100000 --unheard

In virtual time, by the core of a monitor line. Each answer has a count in it, so it is known which request its device
gave a value to. Counted apart is what nobody can detect: answers that came after their late window; answers of a unit
that keeps what it is asked, and is one answer behind for longer than its window, since a request that was not heard
whole; with --unheard also answers to requests of which the monitor has heard nothing; and frames that nobody has sent
whose check sum fits by chance. Ends with status 0 if nothing else was wrong. The same seed gives the same run.
"""

import argparse
import random
import sys
import time
from collections import Counter, deque
from itertools import islice
from math import inf
from pathlib import Path
from typing import Final

if __name__ == "__main__":
    sys.path.insert(0, str(Path(__file__).parents[1]))

from gateway.events import discard_event
from gateway.lines.monitor.monitor import HeardTransaction, Monitor
from gateway.lines.settings import LineSettings
from gateway.modbus.pdu import can_be_read_both_ways
from gateway.timing.characters import CharacterFormat, LineTiming
from gateway.trace.ring import Ring
from soak.monitor_bus import WINDOWS, Client, Device, Frame, World

TIMINGS: Final = {
    "rtu": LineTiming("rtu", 38400, CharacterFormat.parse("8E1")),
    "ascii": LineTiming("ascii", 38400, CharacterFormat.parse("7E1")),
}
#: What a port may add to the age of what it has read, in seconds; and a gateway that stood still unnoticed.
_UNNOTICED: Final = 2.2
#: What happens to frames on the way to the monitor. Only with --unheard it hears nothing at all of a request.
WAYS: Final = {"flipped": 1.0, "cut": 1.0, "noise": 1.0, "glitch": 1.0, "not heard": 0.5}
#: So many frames that were sent are remembered.
_SENT: Final = 400


class Listener:
    """The adapter and the driver of a monitor, and the judge of what it tells."""

    def __init__(self, world: World, *, unheard: bool) -> None:
        self.world, self._unheard = world, unheard
        world.ways = WAYS
        world.stand_still = self._stand_still
        self.tally: Counter[str] = Counter()
        self.wrong: list[str] = []
        self.oldest = 0.0
        self.spent = 0.0
        self.monitor = Monitor(
            LineSettings("old-plc", world.timing, turnaround=0.1),
            lambda unit, _: WINDOWS.get(unit, 5.0),
            discard_event,
            Ring(1 << 18),
            self._judge,
        )
        self.monitor.port_up(world.now)
        #: What can be read, in pieces; since when it stands still, and how long it will.
        self._pieces: deque[tuple[bytes, bool]] = deque()
        self._still_until = self._comes_at = -inf
        self._ticks_at = inf
        self._sent: deque[bytes] = deque(maxlen=_SENT)
        self._passed: deque[str] = deque(maxlen=30)
        world.listeners.append(self._hear)
        self._plan()

    def _hear(self, frame: Frame) -> None:
        """Something has passed on the wire: it comes to the port a little later, in pieces."""
        world, dice = self.world, self.world.dice
        self._sent.append(frame.data)
        data, fault, damaged = frame.data, frame.fault, False
        if frame.collided or fault == "flipped":
            data = _flipped(data, dice, dice.randint(3, 12) if frame.collided else dice.randint(1, 3))
            damaged = dice.random() < 0.3
        elif fault == "cut":
            data = _cut(data, dice)
        elif fault == "not heard" and (frame.to is not None or self._unheard):
            data = b""
        elif fault == "noise":
            data = (data + dice.randbytes(dice.randint(1, 12))) if dice.random() < 0.5 else dice.randbytes(4) + data
        elif fault == "glitch":
            data = dice.choice((b"\0", b"\xff", b"\xf0\0", b"\xfe")) + data
        self._note(frame, data)
        if data:
            self._comes_at = max(self._comes_at, world.now + dice.choice((0.0, 0.0, 0.001, 0.016)))
            world.at(self._comes_at, lambda: self._arrive(data, damaged=damaged))

    def _arrive(self, data: bytes, *, damaged: bool) -> None:
        dice = self.world.dice
        while not damaged and len(data) > 1 and dice.random() < 0.4:
            size = dice.randint(1, len(data) - 1)
            self._pieces.append((data[:size], False))
            data = data[size:]
        self._pieces.append((data, damaged))
        if self.world.meets("stands still", 0.05):
            self._stand_still()
        self.world.at(max(self.world.now, self._still_until), self._read)

    def _stand_still(self) -> None:
        self._still_until = self.world.now + self.world.dice.choice((0.3, 0.7, 1.5, 4.0, 12.0))

    def _read(self) -> None:
        """The loop reads the port, some of it or all."""
        if self.world.now < self._still_until:
            self.world.at(self._still_until, self._read)
            return
        if self.world.dice.random() < 0.5 or any(damaged for _, damaged in self._pieces):
            self._read_all()
        elif self._pieces:
            data = b"".join(data for data, _ in self._pieces)
            self._pieces.clear()
            self._give(data, damaged=False)
        self._plan()

    def _read_all(self) -> None:
        while self._pieces:
            data, damaged = self._pieces.popleft()
            self._give(data, damaged=damaged)

    def _give(self, data: bytes, *, damaged: bool) -> None:
        begin = time.thread_time()
        self.monitor.received(data, self.world.now, damaged=damaged)
        self.spent += time.thread_time() - begin

    def _plan(self) -> None:
        deadline = self.monitor.deadline()
        if deadline is not None and deadline < self._ticks_at:
            self._ticks_at = deadline
            self.world.at(deadline, lambda: self._tick(deadline))

    def _tick(self, planned: float) -> None:
        world = self.world
        if planned != self._ticks_at:
            return
        if world.now < self._still_until:
            world.at(self._still_until, lambda: self._tick(planned))
            return
        self._ticks_at = inf
        self._read_all()
        deadline = self.monitor.deadline()
        if deadline is not None and deadline <= world.now:
            begin = time.thread_time()
            self.monitor.tick(world.now)
            self.spent += time.thread_time() - begin
        self._plan()

    def _judge(self, heard: HeardTransaction, _: float) -> None:
        """Whether the device gave this value to this request."""
        tally, response = self.tally, heard.response
        tally["heard"] += 1
        if response is None:
            tally["without an answer"] += 1
            return
        tally["answered"] += 1
        if response.pdu[0] & 0x80 or heard.asked.read is None:
            tally["exceptions, writes"] += 1
            return
        tally["reads"] += 1
        if can_be_read_both_ways(response.pdu) or can_be_read_both_ways(heard.asked.data):
            tally["reads that can be read both ways"] += 1
            self._need(not heard.is_sure, "both ways", heard)
            return
        if not heard.is_sure:
            return
        tally["believed"] += 1
        given = list(islice(self.world.given_as(heard.unit, response.pdu), 1))
        if given and given[0][0].pdu != heard.asked.data:
            given += islice(self.world.given_as(heard.unit, response.pdu), 1, 3)
        right = [to for to, at in given if to.pdu == heard.asked.data and at - to.ends <= WINDOWS[heard.unit]]
        if right:
            age = heard.asked_at - right[0].ends
            self.oldest = max(self.oldest, age)
            self._need(age < _UNNOTICED, f"told as {age:.3f} s younger than it is", heard)
            return
        why = self._excuse(heard, response.pdu, given)
        tally[why] += bool(why)
        self._need(bool(why), f"given to {[to.pdu.hex(' ') for to, _ in given]}", heard)

    def _excuse(self, heard: HeardTransaction, response: bytes, given: list[tuple[Frame, float]]) -> str:
        """Tell why nobody can know that this value was given to another request; empty if it can be known."""
        spoilt_at = max((to.backlog.spoilt_at for to, _ in given), default=-inf)
        if any(at - to.ends > WINDOWS[heard.unit] for to, at in given):
            return "answers behind their window"
        if self._unheard and spoilt_at > -inf:
            return "answers to requests that were not heard, or of units one behind since"
        if -inf < spoilt_at < self.world.now - WINDOWS[heard.unit]:
            return "answers of units that are one behind since a request that was not heard whole"
        if not all(self._was_sent(heard.unit, pdu) for pdu in (heard.asked.data, response)):
            return "by chance"
        return ""

    def _was_sent(self, unit: int, pdu: bytes) -> bool:
        return any(self.world.encode(unit, pdu) in each for each in self._sent)

    def _need(self, right: bool, text: str, heard: HeardTransaction) -> None:
        if right:
            return
        self.tally["WRONG"] += 1
        if len(self.wrong) < 5:
            told = f"{heard.unit} {heard.asked.data.hex(' ')} -> {heard.response and heard.response.pdu.hex(' ')}"
            self.wrong.append("\n".join((*self._passed, f"{self.world.now:.4f} {told}: {text}")))

    def _note(self, frame: Frame, data: bytes) -> None:
        way = ">>" if frame.to is None else f"<< to {frame.to.pdu.hex(' ')}:"
        heard = "" if data == frame.data else f" heard as {data.hex(' ')}"
        self._passed.append(f"{frame.ends:.4f} {frame.unit} {way} {frame.pdu.hex(' ')}{heard}")


def _flipped(data: bytes, dice: random.Random, bits: int) -> bytes:
    changed = bytearray(data)
    for bit in {dice.randrange(8 * len(data)) for _ in range(bits)}:
        changed[bit // 8] ^= 1 << bit % 8
    return bytes(changed)


def _cut(data: bytes, dice: random.Random) -> bytes:
    """Some of its bytes are missing, at the beginning, the end, or between."""
    at, size = dice.randrange(len(data)), dice.randint(1, len(data) - 1)
    return data[:at] + data[at + size :]


def run(mode: str, transactions: int, faults: float, seed: int, *, unheard: bool) -> bool:
    """Play one run and print what came of it; whether nothing was wrong."""
    world = World(TIMINGS[mode], random.Random(f"{seed} {mode}"), faults)
    for unit in WINDOWS:
        Device(world, unit)
    Client(world, 0.02)
    if faults:
        Client(world, 2.0)
    listener = Listener(world, unheard=unheard)
    begin, tally = time.monotonic(), listener.tally
    while tally["heard"] < transactions:
        world.step()
    both = tally["reads"] - tally["reads that can be read both ways"]
    print(*listener.wrong, sep="\n\n")
    print(f"--- {mode}, faults {faults:.1%}{', requests that are not heard' * unheard}, seed {seed}")
    print("faults:", ", ".join(f"{name} {count}" for name, count in sorted(world.injected.items()) if count))
    print("told:", ", ".join(f"{name} {count}" for name, count in tally.items()))
    print("counted:", listener.monitor.counts)
    print(f"believed: {tally['believed'] / max(1, both):.2%} of the reads that can be read in one way")
    print(f"{world.now - 1000:.0f} s of the bus in {time.monotonic() - begin:.0f} s;", end=" ")
    print(f"{1e6 * listener.spent / tally['heard']:.0f} us of the monitor for each transaction")
    print(f"told as younger than they are: at most {listener.oldest:.3f} s; wrong: {tally['WRONG']}", flush=True)
    return not tally["WRONG"]


def main() -> int:
    """Run what was asked for."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--transactions", type=int, default=1_000_000)
    parser.add_argument("--faults", default="1%", help="share of the frames that meet each kind of fault")
    parser.add_argument("--unheard", action="store_true", help="of some requests the monitor hears nothing")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--mode", choices=TIMINGS, action="append", help="by default both")
    args = parser.parse_args()
    faults = float(args.faults.removesuffix("%")) / 100
    ok = [run(mode, args.transactions, faults, args.seed, unheard=args.unheard) for mode in args.mode or TIMINGS]
    return 0 if all(ok) else 1


if __name__ == "__main__":
    sys.exit(main())
