"""A device on a line: its framer, and the response that it prepares or sends."""

from collections.abc import Callable
from random import Random

from gateway.modbus import ascii as ascii_framing
from gateway.modbus import rtu
from gateway.modbus.frame import Frame
from gateway.simulator.device import Device, Mode
from gateway.simulator.framer import AsciiFramer, Framer, RtuFramer
from gateway.simulator.pace import Transmission
from gateway.timing.characters import LineTiming


class Station:
    """Connects `device` to a line with `mode`. It responds at the rate of the request.

    A device handles one request at a time: while it prepares or sends a response, it ignores others.
    """

    def __init__(self, device: Device, mode: Mode, dice: Random) -> None:
        self._device = device
        self._framer: Framer = RtuFramer() if mode == "rtu" else AsciiFramer()
        self._encode: Callable[[int, bytes], bytes] = rtu.encode if mode == "rtu" else ascii_framing.encode
        self._dice = dice
        self._timing: LineTiming | None = None
        self._answer: Transmission | None = None
        self._sends = False

    def receive(self, sent: Transmission) -> None:
        """Receive a transmission of another station. At another rate than the device's own it is noise."""
        timing = sent.timing
        if self._device.baud not in {None, timing.baud}:
            self._framer.spoil()
            return
        self._timing = timing
        self._framer.receive(sent.data, sent.start, timing.character, timing.silence(self._device.profile.idle_chars))

    def deadline(self) -> float | None:
        """Return when the next action is due, or None."""
        own, frame = self._next_of_answer(), self._framer.deadline()
        return frame if own is None else own if frame is None else min(own, frame)

    def listen(self, now: float) -> None:
        """Process the frames that have ended by `now`, and prepare the response."""
        for frame in self._framer.take(now):
            if self._answer is None and self._timing is not None:
                self._answer = self._prepare(frame, now, self._timing)

    def begin(self, now: float) -> Transmission | None:
        """Return the response if it begins now, else None."""
        if self._answer is None or self._sends or now < self._answer.start:
            return None
        self._sends = True
        return self._answer

    def sends_at(self, time: float) -> bool:
        """Tell whether its response is on the line at `time`."""
        return self._sends and self._answer is not None and time < self._answer.end

    def take(self, now: float) -> bytes:
        """Return the characters of its response that have arrived since the last call."""
        if self._answer is None or not self._sends:
            return b""
        data = self._answer.take(now)
        if self._answer.is_over:
            self._answer, self._sends = None, False
        return data

    def disturb(self) -> None:
        """Drop the frame being received, and damage the response being sent: there was a collision."""
        self._framer.spoil()
        if self._answer is not None and self._sends:
            self._answer.garble(self._dice)

    def _next_of_answer(self) -> float | None:
        if self._answer is None:
            return None
        return self._answer.next_arrival() if self._sends else self._answer.start

    def _prepare(self, frame: Frame, now: float, timing: LineTiming) -> Transmission | None:
        answer = self._device.receive(frame, now, timing.baud)
        if answer is None:
            return None
        adu = self._encode(answer.frame.unit, answer.frame.pdu)
        return Transmission(self._device.faults.on_the_line(adu, self._dice), now + answer.delay, timing)
