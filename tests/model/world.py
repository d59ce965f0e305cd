"""The real machine of a line between clients and the model of a wire.

It is driven through its public side only: `submit` of its devices, `received`, `tick`, `deadline`, `port_up`,
`port_down`, `finish`. What may happen to it is in `letters`. What it must keep to, whatever happens:

- Each request is answered once, in time, with its own answer or with an exception that says the truth.
- No two devices come to have one address.
- No write goes out twice. That of a register whose bits are written follows the read of it, and has what was read.
- Nothing goes out that nobody asks for, nor before the line was silent, nor while the answer to the last request may
  come in time.
- Every wait ends.
"""

from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace
from typing import Final

from gateway.devices.addresses import UnitAddresses
from gateway.devices.device import Device, DeviceSettings, EveryDevice
from gateway.devices.quirks import MovableDevice
from gateway.events import EchoHeard, Event
from gateway.lines.line import Line
from gateway.lines.settings import LineSettings
from gateway.modbus.codes import BROADCAST_UNIT, EXCEPTION_BIT, FunctionCode
from gateway.modbus.pdu import parse_request
from gateway.modbus.scan_rtu import RtuScanner
from gateway.profiles.profile import Profile
from gateway.registers.masks import read_before, write_after
from gateway.request import Caller, Origin, Request
from gateway.timing.budget import AnswerTime
from gateway.timing.table import TimingTable
from model.picture import EPOCH, PLACES
from model.picture import picture as picture_of
from model.wire import LATENCY, MOVE, TIMEOUT, Asking, Wire

#: No request may take longer, in seconds.
PATIENCE: Final = 20.0
#: No response comes later than so many seconds after its request.
_LONGEST_WAIT: Final = 1.5
#: Times are compared to so many seconds.
A_MOMENT: Final = 1e-6
#: What the gateway answers itself: to what it has not sent, and to anything.
_NOT_SENT: Final = (0x06, 0x0A)
_NO_ANSWER: Final = 0x0B
#: And to a change of an address that another device may have; to a write to bits while another client may be there.
_REFUSED: Final = 0x03
_SHARED: Final = 0x04
#: The function that writes a register whose bits are written.
_WRITE: Final = 0x06
#: So often a line may be woken while time passes.
_WAKES: Final = 1000

_ANSWER_TIME: Final = AnswerTime(TimingTable(), margin=1.5, timeout=TIMEOUT)
_MOVABLE: Final = Profile("generic", quirks=frozenset({"moves"}))
_UNITS: Final = {unit: DeviceSettings(f"unit-{unit}", unit, unit, Profile("generic"), _ANSWER_TIME) for unit in (1, 3)}


@dataclass(frozen=True, slots=True)
class Setting:
    """A line as it is configured and as it is, what may happen to it, and what has happened before.

    A real line takes its time. `echoes` says what the adapter does, whatever the settings of the line say. With `moves`
    the devices change their addresses; they sleep after `wake` seconds without a request.
    """

    name: str
    line: LineSettings
    is_real: bool
    echoes: bool
    letters: tuple[str, ...]
    before: tuple[str, ...] = ()
    moves: bool = False
    wake: float = 0.0


class Question(Origin):
    """A client's request, as its Origin; `then` is what the client does when it is answered."""

    def __init__(
        self, world: "World", client: str, unit: int, pdu: bytes, then: Callable[["World"], None] | None
    ) -> None:
        self.client = client
        self.caller = Caller(client, "127.0.0.1", "127.0.0.1")
        self.unit = unit
        self.pdu = pdu
        self.asked_at = world.now
        self.is_gone = False
        self.answers: list[bytes | None] = []
        #: How often it may have been written, and whether it was sent: equal reads look alike on the wire.
        self.sent = 0
        self.was_sent = False
        self._world = world
        self._then = then

    @property
    def is_of_bits(self) -> bool:
        """Whether it is a write to bits, which is sent as a read and a write."""
        return self.pdu[0] == FunctionCode.MASK_WRITE_REGISTER

    def may_be_sent_as(self, pdu: bytes, answers: Iterable[tuple[bytes, bytes]]) -> bool:
        """Whether it may go out as this PDU, by the answers that it had so far, each with what was sent."""
        if not self.is_of_bits:
            return pdu == self.pdu
        read = read_before(self.pdu)
        values = [int.from_bytes(answer[2:]) for sent, answer in answers if sent == read and answer[0] == read[0]]
        return pdu == read or (bool(values) and pdu == write_after(self.pdu, values[-1], _WRITE))

    def answer_for(self, sent: bytes, pdu: bytes) -> bytes | None:
        """What the client gets when this comes for what was sent; None if that is no answer."""
        if not self.is_of_bits:
            return pdu
        if pdu[0] & EXCEPTION_BIT:
            return bytes((self.pdu[0] | EXCEPTION_BIT, pdu[1]))
        return self.pdu if sent[0] == _WRITE else None

    @property
    def is_answered(self) -> bool:
        """Whether some device answers it."""
        return self.unit != BROADCAST_UNIT and parse_request(self.pdu).is_answered

    def wants(self, request: Request) -> bool:
        return not self.is_gone

    def answer(self, request: Request, pdu: bytes | None) -> None:
        self.answers.append(pdu)
        self._world.answered(self, pdu)
        if self._then is not None:
            self._then(self._world)

    def __repr__(self) -> str:
        return f"{self.client}'s {self.pdu.hex(' ')} to {self.unit}"


class World:
    """A line with all that is around it. `wrong` is what it did against the rules, `story` all that happened."""

    def __init__(self, setting: Setting) -> None:
        self.setting = setting
        self.now = EPOCH
        self.wrong: list[str] = []
        self.story: list[str] = []
        #: What is remembered of devices that move.
        self._remembered: dict[int, tuple[int, ...]] = {}
        self._begin()
        self.wire = Wire(setting.line.timing, takes_time=setting.is_real, moving=_UNITS if setting.moves else ())
        self.open: list[Question] = []
        #: The request on the line, and its echo that is still to come.
        self.sent: Asking | None = None
        self.echo = b""
        #: What has come and is read only together with what comes next; None if nothing is held back.
        self.held: bytes | None = None
        #: What was written last.
        self.written: tuple[int, bytes] | None = None
        #: The shape of the last answer, and its frame.
        self.last: tuple[tuple[int, int], bytes] | None = None
        self.is_up = False
        self.is_finished = False
        self.is_echo_told = False
        self._silent_at = 0.0
        self.plug()
        self.pass_until(self.now + 1.0)

    def _begin(self) -> None:
        """A new line, with its devices."""
        self.line = Line(self.setting.line, self._told)
        self._scanner = self.line._receiver._scanner
        self._scanner.position = PLACES
        if isinstance(self._scanner, RtuScanner):
            self._scanner._scanned = PLACES
        addresses = UnitAddresses()
        self.devices = {unit: self._device(settings, addresses) for unit, settings in _UNITS.items()}
        self.everyone = EveryDevice(self.line)

    def _device(self, settings: DeviceSettings, addresses: UnitAddresses) -> Device:
        settings = replace(settings, wake=self.setting.wake)
        if not self.setting.moves:
            return Device(settings, self.line)

        def remember(*units: int) -> None:
            self._remembered[settings.unit] = units

        device = MovableDevice(
            replace(settings, profile=_MOVABLE), self.line, line_name="", line_source="", addresses=addresses,
            change_rate=None, remember=remember, emit=self._told,
        )  # fmt: skip
        device.begin_at(*self._remembered.get(settings.unit, (settings.unit,)))
        return device

    def picture(self) -> int:
        """What matters of it, as one number."""
        return picture_of(self, self.now, self._scanner.position)

    def happens(self, what: str, does: Callable[["World"], None]) -> None:
        """Let this happen."""
        self._tell(what)
        try:
            does(self)
        except Exception as error:  # noqa: BLE001 - the machine must not raise, whatever happens
            self.wrong.append(f"{type(error).__name__}: {error}")
        self.wrong += self.wire.clashes
        self.wire.clashes.clear()
        self._forget()

    # --- what happens to the line ---

    def ask(self, client: str, unit: int, pdu: bytes, then: Callable[["World"], None] | None) -> None:
        """A client asks. A write of a register has a value of its own."""
        if pdu[0] == 6:
            taken = [each.pdu for each in (*self.open, *self.wire.askings)]
            pdu = next(each for value in range(256) if (each := pdu[:-1] + bytes((value,))) not in taken)
        question = Question(self, client, unit, pdu, then)
        self.open.append(question)
        request = Request(unit, pdu, question, self.now)
        request.in_one_turn = _WRITE if question.is_of_bits else 0
        (self.devices.get(unit) or self.everyone).submit(request, self.now)

    def hear(self, data: bytes = b"", *, damaged: bool = False) -> None:
        """The line delivers this, and before it the echo of what was sent."""
        data, self.echo = self.echo + data, b""
        if self.held == b"":
            self.held = data
            return
        data, self.held = (self.held or b"") + data, None
        if data:
            self._tell(f"    << {data.hex(' ')}")
            self._silent_at = max(self._silent_at, self.now + self.setting.line.silence_before_request)
            self.line.received(data, self.now, damaged=damaged)

    def answer(self, asking: Asking, pdu: bytes) -> None:
        """A device answers, or goes on to answer."""
        if asking.has_begun:
            frame = self.wire.ends(asking)
        else:
            frame = self.wire.answers(asking, pdu)
            self.last = asking.shape, frame
        if self.sent is not None and any(question in self.sent.questions for question in asking.questions):
            self.sent = None  # answered; if that was on the wire twice, one more answer follows
        self.hear(frame)

    def pass_until(self, end: float) -> None:
        """Let time pass as the driver does: the line is woken at each of its deadlines. Echoes do not wait."""
        for _ in range(_WAKES):
            self.hear()
            deadline = self.line.deadline()
            if deadline is None or deadline > end:
                break
            self.now = max(deadline, self.now)
            self.line.tick(self.now)
        else:
            self.wrong.append("the line wakes again and again")
        self.now = end
        self._forget()

    def oversleep(self) -> None:
        """The gateway is busy elsewhere until a deadline of the line is over."""
        self.hear()
        self.now = max(self.now, (self.line.deadline() or 0.0) + A_MOMENT)

    def plug(self) -> None:
        """The port is there."""
        self.is_up = True
        self._silent_at = self.now + self.setting.line.silence_before_request
        self.line.port_up(self._write, LATENCY, self.now, virtual=not self.setting.is_real)

    def unplug(self) -> None:
        """The port is lost, and what was under way to it."""
        self.is_up = False
        self.echo = b""
        self.sent = None
        self.wire.cut()
        self.line.port_down(self.now)

    def reload(self) -> None:
        """Another line follows this one, which has finished, on the port, and takes over what may still come there."""
        overdue = self.line.ledger.handed_on(self.now, _LONGEST_WAIT)
        self._begin()
        self.line.ledger.take_over(overdue, _LONGEST_WAIT)
        self.plug()

    def leave(self, client: str) -> None:
        """A client closes its connection."""
        for question in self.open:
            question.is_gone = question.is_gone or question.client == client

    def finish(self) -> None:
        """The line is to end."""
        self.is_finished = True
        self.line.finish(self.now)

    def _forget(self) -> None:
        """What is over matters no more."""
        self.wire.forget(self.now)
        self._silent_at = max(self._silent_at, self.now)
        sent = self.sent
        if sent is not None and self.now >= (sent.fails_at if sent.is_owed else sent.left_at):
            self.sent = None

    # --- what the line does ---

    def answered(self, question: Question, pdu: bytes | None) -> None:
        """A client is answered."""
        self._tell(f"    {question}: {'ends' if pdu is None else pdu.hex(' ')}")
        if question in self.open:
            self.open.remove(question)
        trouble = self._trouble(question, pdu)
        if trouble:
            self.wrong.append(f"{question} got {pdu and pdu.hex(' ')}: {trouble}")

    def _trouble(self, question: Question, pdu: bytes | None) -> str:
        """What is wrong with an answer, if anything."""
        if len(question.answers) > 1:
            return "a second answer"
        if self.now > question.asked_at + PATIENCE:
            return "too late"
        if pdu is None:
            return "no answer, though its client is there" if question.is_answered and not question.is_gone else ""
        if pdu[0] & EXCEPTION_BIT and pdu[1] in _NOT_SENT:
            return "but it was sent" if question.was_sent and not question.is_gone else ""
        if pdu[0] & EXCEPTION_BIT and self._may_refuse(question, pdu[1]):
            return ""
        its_own = [
            question.answer_for(asking.pdu, pdu)
            for asking in self.wire.askings
            if question in asking.questions and asking.device == question.unit
            for pdu in asking.delivered
        ]
        return "" if pdu in its_own else "that is not the answer to it"

    def _may_refuse(self, question: Question, code: int) -> bool:
        """Whether the gateway may answer with this exception, whether or not it has sent anything."""
        if code == _REFUSED:
            return self.setting.moves and question.pdu.startswith(MOVE) and not question.was_sent
        if code == _SHARED:  # it may suspect another client where a damaged frame was heard
            return question.is_of_bits and not question.sent and self.line.ledger.other_client is not None
        return code == _NO_ANSWER

    def _write(self, data: bytes) -> None:
        self._tell(f"    >> {data.hex(' ')}")
        unit, pdu = self.wire.decoded(data)
        answers = [
            (each, (asking.pdu, one))
            for asking in self.wire.askings
            for each in asking.questions
            for one in asking.delivered
        ]
        questions = [
            each
            for each in self.open
            if unit == self._address(each.unit)
            and each.may_be_sent_as(pdu, [answer for question, answer in answers if question is each])
        ]
        if not self.is_up:
            self.wrong.append("sent through a port that has gone")
        if not questions:
            self.wrong.append("sent, and nobody asks for it")
        if self.now < self._silent_at - A_MOMENT:
            self.wrong.append(f"sent {self._silent_at - self.now:.6f} s before the silence is over")
        if self.sent is not None and self.sent.is_owed and self.now < self.sent.fails_at - A_MOMENT:
            self.wrong.append("sent while the answer to the last request is still awaited")
        is_write = not parse_request(pdu).only_reads
        if is_write and any(each.is_of_bits and self.written != (unit, read_before(each.pdu)) for each in questions):
            self.wrong.append("sent after something else than the read of its register")
        self.written = unit, pdu
        for question in questions:
            question.sent += is_write
            question.was_sent = question.was_sent or len(questions) == 1
            if question.sent > 1:
                self.wrong.append(f"a write is sent again: {question}")
        asking = self.wire.asked(data, questions, self.now)
        settings, is_answered = self.setting.line, any(question.is_answered for question in questions)
        self.sent = asking if is_answered else None
        silence = settings.silence_before_request if is_answered else settings.turnaround
        self._silent_at = silence + (asking.left_at if self.setting.is_real else self.now)
        if self.setting.echoes:
            self.echo = data

    def _address(self, unit: int) -> int:
        """Where the gateway asks this unit."""
        return self.devices[unit].unit if unit in self.devices else unit

    def _told(self, event: Event) -> None:
        self._tell(f"    {event.name}")
        self.is_echo_told = self.is_echo_told or isinstance(event, EchoHeard)

    def _tell(self, what: str) -> None:
        self.story.append(f"{self.now - EPOCH:.6f} {what}")
