"""The alphabet: everything that may happen to a line, each with a name, when it may happen, and what then happens.

do(world, "read")
do(world, "answer")
enabled(world)          # what may happen next
drain(world)            # let it come to its end: every wait ends, and the line serves as if nothing had been
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Final

from gateway.modbus.codes import EXCEPTION_BIT
from gateway.modbus.pdu import parse_request
from kit.noise import flipped
from model.wire import LATENCY, Asking
from model.world import A_MOMENT, PATIENCE, World

#: So many requests are open at once.
_OPEN: Final = 3
#: Longer than any unit rests here, and than another client's request is remembered, in seconds.
_LONG: Final = 400.0
#: How long to wait before looking again if a request was repeated, in seconds.
_STEP: Final = 0.01
#: Where a device may be after changes of its address.
_PLACES: Final = 3
#: So long before a window ends an answer may just come.
_JUST: Final = 0.01


@dataclass(frozen=True, slots=True)
class Letter:
    """One thing that may happen. If it `speaks`, bytes come, which may be read together with those before them."""

    may: Callable[[World], object]
    does: Callable[[World], None]
    speaks: bool = False


def enabled(world: World) -> list[str]:
    """What may happen now."""
    return [
        name
        for name in world.setting.letters
        if LETTERS[name].may(world) and (world.held is None or LETTERS[name].speaks)
    ]


def do(world: World, name: str) -> None:
    """Let this happen."""
    world.happens(name, LETTERS[name].does)


def drain(world: World) -> None:
    """Let time pass until everything is over, then see whether the line serves."""
    world.happens("time passes", _end)
    if world.is_finished:
        return
    if not world.is_up:
        world.happens("port back", World.plug)
    world.happens("time passes", lambda world: world.pass_until(world.now + 1.0))
    _serves(world, "read")
    if not world.is_echo_told:  # a line that may echo confirms no write
        _serves(world, "write")


def _end(world: World) -> None:
    world.held = world.held or None
    world.pass_until(world.now + PATIENCE)
    world.wrong += [f"{question} has no answer" for question in world.open]
    world.open.clear()
    if world.line.is_busy or len(world.line.queue):
        world.wrong.append("the line is not idle in the end")
    world.pass_until(world.now + _LONG)
    if world.line.deadline() is not None:
        world.wrong.append("the line still waits for something when everything is over")


def _serves(world: World, name: str) -> None:
    """Whether a request is sent at once and its answer believed; a device that may have moved is sought first."""
    sendings = 1 + world.setting.line.retries + (world.setting.wake > 0.0)
    for _ in range(_PLACES if world.setting.moves else 1):
        do(world, name)
        if world.sent is None:
            world.wrong.append("when everything is over, the line does not send")
            return
        (question,) = world.sent.questions
        if any(_is_heard(world) for _ in range(sendings)):
            break
        world.pass_until(world.now + _LONG)
    else:
        world.wrong.append("when everything is over, the line asks where no device is")
        return
    do(world, "answer")
    if not question.answers or question.answers[0][0] & EXCEPTION_BIT:
        world.wrong.append("when everything is over, the line does not believe an answer")
    world.pass_until(world.now + 1.0)


def _is_heard(world: World) -> bool:
    """Whether a device hears what is being sent. If none does, time passes until the repeat, which may go elsewhere."""
    asking = world.sent
    if asking is not None:
        world.pass_until(asking.left_at + A_MOMENT)
        if world.wire.owed(world.now, ours=True):
            return True
    end = world.now + PATIENCE
    while world.sent in (None, asking) and world.now < end:
        world.pass_until(world.now + _STEP)
    return False


# --- clients ---


def _asks(client: str, unit: int, pdu: str, then: str = "") -> Letter:
    data = bytes.fromhex(pdu)

    def may(world: World) -> bool:
        """Of what nothing tells apart, and must not be sent twice, there is only one."""
        is_told_apart = data[0] == 6 or parse_request(data).only_reads
        is_one = is_told_apart or all(question.pdu != data for question in world.open)
        return len(world.open) < _OPEN and not world.is_finished and is_one

    next_one = (lambda world: do(world, then)) if then else None
    return Letter(may, lambda world: world.ask(client, unit, data, next_one))


def _leaves(client: str) -> Letter:
    return Letter(
        lambda world: any(question.client == client and not question.is_gone for question in world.open),
        lambda world: world.leave(client),
    )


# --- devices ---


def _may_speak(world: World) -> bool:
    """Whether a frame may begin: the port is there, and no other frame is only half there.

    Where an echo is expected, nothing comes between the request and its end.
    """
    setting, sent = world.setting, world.sent
    is_leaving = setting.is_real and setting.line.echo and sent is not None and world.now < sent.left_at
    return world.is_up and not is_leaving and not any(each.has_begun for each in world.wire.askings)


def _answers(does: Callable[[World, Asking], None], *, ours: bool = True, newest: bool = False) -> Letter:
    """The device that was asked first, or last if it is not the same, does this."""
    return Letter(
        lambda world: _may_speak(world) and len(world.wire.owed(world.now, ours=ours)) > newest,
        lambda world: does(world, world.wire.owed(world.now, ours=ours)[-1 if newest else 0]),
        speaks=True,
    )


def _rightly(world: World, asking: Asking) -> None:
    world.answer(asking, asking.answer)


def _with_an_exception(world: World, asking: Asking) -> None:
    world.answer(asking, asking.refusal)


def _half(world: World, asking: Asking) -> None:
    world.hear(world.wire.begins(asking))


def _unheard(world: World, asking: Asking) -> None:
    world.wire.loses(asking)
    world.hear()


def _with_a_wrong_check_sum(world: World, asking: Asking) -> None:
    world.hear(world.wire.with_wrong_check_sum(world.wire.loses(asking)))


def _with_a_wrong_unit(world: World, asking: Asking) -> None:
    world.hear(world.wire.with_wrong_unit(world.wire.loses(asking)))


def _with_a_parity_error(world: World) -> None:
    world.hear()
    world.hear(world.wire.loses(world.wire.owed(world.now, ours=True)[0]), damaged=True)


def _begun(world: World) -> list[Asking]:
    return [each for each in world.wire.owed(world.now, ours=True) if each.has_begun and world.is_up]


def _may_copy(world: World) -> bool:
    return _may_speak(world) and world.last is not None and not world.wire.is_awaited(world.last[0], world.now)


def _may_reload(world: World) -> bool:
    """Not while a response may come in time: the next line does not wait for it, which costs that response."""
    return world.is_up and world.sent is None and not (world.line.is_busy or world.is_finished or world.echo)


# --- other clients, the adapter, time ---


def _other_asks(unit: int, pdu: str) -> Letter:
    data = bytes.fromhex(pdu)
    return Letter(
        lambda world: _may_speak(world) and world.wire.may_ask(unit, data, world.now),
        lambda world: world.hear(world.wire.other_asked(unit, data, world.now)),
        speaks=True,
    )


def _hold_back(world: World) -> None:
    world.hear()
    world.held = b""


def _lose_echo(world: World) -> None:
    world.wire.loses_echo()
    world.echo = b""


def _damage_echo(world: World) -> None:
    world.wire.loses_echo()
    world.echo = flipped(world.echo, 9)
    world.hear()


def _reload(world: World) -> None:
    world.line.finish(world.now)
    world.pass_until(_silent_at(world))
    world.reload()
    world.pass_until(_silent_at(world))


def _until(when: Callable[[World], float]) -> Letter:
    """Let time pass until then, and a moment longer; not if that is over."""
    return Letter(lambda world: when(world) > world.now, lambda world: world.pass_until(when(world) + A_MOMENT))


def _left_at(world: World) -> float:
    return world.sent.left_at if world.sent is not None and world.setting.is_real else 0.0


def _fails_at(world: World) -> float:
    return world.sent.fails_at if world.sent is not None and world.sent.is_owed else 0.0


def _silent_at(world: World) -> float:
    settings = world.setting.line
    return world.now + max(settings.frame_end + LATENCY, settings.silence_before_request)


LETTERS: Final[dict[str, Letter]] = {
    "read": _asks("a", 1, "03 00 10 00 01"),
    "write": _asks("a", 1, "06 00 30 00 00"),
    "same read": _asks("b", 1, "03 00 10 00 01"),
    "other read": _asks("b", 1, "03 00 20 00 01"),
    "read with other function": _asks("b", 1, "04 00 10 00 01"),
    "read from other unit": _asks("b", 3, "03 00 10 00 01"),
    "read, then other read": _asks("a", 1, "03 00 10 00 01", "other read"),
    "other write": _asks("b", 1, "06 00 31 00 00"),
    "bits": _asks("a", 1, "16 00 40 FF 0F 00 A0"),
    "other bits": _asks("b", 1, "16 00 41 FF FE 00 01"),
    "switch": _asks("a", 1, "05 00 30 FF 00"),
    "read coils": _asks("a", 1, "01 00 20 00 18"),
    "read coils further on": _asks("b", 1, "01 03 10 00 18"),
    "move": _asks("a", 1, "10 01 00 00 01 02 00 05"),
    "move back": _asks("a", 1, "10 01 00 00 01 02 00 01"),
    "other unit moves there": _asks("b", 3, "10 01 00 00 01 02 00 05"),
    "other unit takes its place": _asks("b", 3, "10 01 00 00 01 02 00 01"),
    "order to listen only": _asks("b", 1, "08 00 04 00 00"),
    "broadcast": _asks("b", 0, "06 00 30 00 00"),
    "client leaves": _leaves("a"),
    "answer": _answers(_rightly),
    "newest answer": _answers(_rightly, newest=True),
    "exception": _answers(_with_an_exception),
    "half an answer": _answers(_half),
    "other half": Letter(_begun, lambda world: _rightly(world, _begun(world)[0]), speaks=True),
    "answer lost": _answers(_unheard),
    "answer with wrong check sum": _answers(_with_a_wrong_check_sum),
    "answer with wrong unit": _answers(_with_a_wrong_unit),
    "answer with parity error": Letter(_answers(_rightly).may, _with_a_parity_error),
    "copy of answer": Letter(_may_copy, lambda world: world.hear(world.wire.again(world.last[1])), speaks=True),
    "foreign read": _other_asks(1, "03 00 10 00 01"),
    "other foreign read": _other_asks(1, "03 00 28 00 01"),
    "foreign read with other function": _other_asks(1, "04 00 28 00 01"),
    "foreign read from other unit": _other_asks(3, "03 00 10 00 01"),
    "foreign read of coils": _other_asks(1, "01 03 10 00 18"),
    "other foreign read of coils": _other_asks(1, "01 00 28 00 18"),
    "foreign write": _other_asks(1, "06 00 38 00 00"),
    "same foreign switch": _other_asks(1, "05 00 30 FF 00"),
    "foreign answer": _answers(_rightly, ours=False),
    "newest foreign answer": _answers(_rightly, ours=False, newest=True),
    "foreign exception": _answers(_with_an_exception, ours=False),
    "foreign answer with wrong check sum": _answers(_with_a_wrong_check_sum, ours=False),
    "foreign answer with wrong unit": _answers(_with_a_wrong_unit, ours=False),
    "noise": Letter(_may_speak, lambda world: world.hear(b"\x55"), speaks=True),
    "next two together": Letter(lambda world: _may_speak(world) and world.held is None, _hold_back),
    "echo": Letter(lambda world: world.echo, World.hear),
    "echo lost": Letter(lambda world: world.echo, _lose_echo),
    "echo damaged": Letter(lambda world: world.echo, _damage_echo),
    "port lost": Letter(lambda world: world.is_up, World.unplug),
    "port back": Letter(lambda world: not world.is_up and not world.is_finished, World.plug),
    "reload": Letter(_may_reload, _reload),
    "finish": Letter(lambda world: not world.is_finished, World.finish),
    "request has left": _until(_left_at),
    "silence": _until(_silent_at),
    "limit": _until(_fails_at),
    "window": _until(lambda world: world.wire.next_end(world.now)),
    "nearly the window": _until(lambda world: world.wire.next_end(world.now) - _JUST),
    "oversleep": Letter(lambda world: (world.line.deadline() or 0.0) > world.now, World.oversleep),
    "rest": _until(lambda world: world.now + _LONG),
}
