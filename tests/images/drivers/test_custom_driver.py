"""The calls of a unit made in Python: its values, its errors, its deadline; nothing in its code reaches others."""

import asyncio
import sys
from contextlib import suppress

import pytest

from gateway.errors import Busy, IllegalAddress, IllegalValue, Refused, RequestError
from gateway.events import CustomUnitFailed, Event, PartFailed, RequestTimeout
from gateway.images.custom_unit import CustomUnit
from gateway.images.drivers.custom_driver import LOGGED_EVERY, CustomDriver
from gateway.images.image import ImageSettings
from gateway.modbus.codes import Area
from gateway.trace.ring import Ring
from images.asking import GENERIC
from kit.asker import Asker

EVERYWHERE = dict.fromkeys(Area, ((0, 0xFFFF),))


class Bench:
    """A unit with this behaviour, called in the loop of the test."""

    def __init__(self, unit: CustomUnit, timeout: float = 1.0) -> None:
        settings = ImageSettings(60, "clock", GENERIC, EVERYWHERE, python="Clock", timeout=timeout)
        self.events: list[Event] = []
        self.loop = asyncio.get_running_loop()
        self.driver = CustomDriver(settings, unit, self.loop, self.events.append, Ring())

    def ask(self, pdu: str, client: Asker | None = None) -> Asker:
        client = client or Asker()
        self.driver.image.submit(client.ask(pdu, unit=60, now=self.loop.time()), self.loop.time())
        return client

    async def asks(self, pdu: str) -> str | None:
        client = self.ask(pdu)
        for _ in range(300):
            if client.answers:
                break
            await asyncio.sleep(0.01)
        (answer,) = client.answers
        return answer

    def failures(self) -> list[CustomUnitFailed]:
        return [event for event in self.events if isinstance(event, CustomUnitFailed)]


class Registers(CustomUnit):
    """Holding registers of a plain list, as its author would write it."""

    def __init__(self) -> None:
        self.values = list(range(100))

    async def read(self, area, address, count):
        await asyncio.sleep(0)
        return self.values[address : address + count]

    async def write(self, area, address, values):
        self.values[address : address + len(values)] = values


class Returns(CustomUnit):
    """A unit that returns the same for every read, or raises it."""

    def __init__(self, result: object) -> None:
        self.result = result

    async def read(self, area, address, count):
        if isinstance(self.result, BaseException):
            raise self.result
        return self.result


async def test_a_unit_is_read_and_written():
    bench = Bench(Registers())
    assert await bench.asks("03 0003 0002") == "03 04 00 03 00 04"
    assert await bench.asks("10 0003 0002 04 0101 FFFF") == "10 00 03 00 02"
    assert await bench.asks("16 0003 FF0F 0050") == "16 00 03 FF 0F 00 50"
    assert await bench.asks("17 0003 0002 0004 0001 02 0007") == "17 04 01 51 00 07"


@pytest.mark.parametrize(("pdu", "answer"), [("03 0000 0001", "83 01"), ("06 0000 0001", "86 01")])
async def test_the_class_itself_has_nothing_to_read_and_to_write(pdu, answer):
    assert await Bench(CustomUnit()).asks(pdu) == answer


@pytest.mark.parametrize(
    ("result", "said"),
    [
        ([1], "read(holding, 7, 2) has returned 1 values, not 2"),
        ([1, 2, 3], "read(holding, 7, 2) has returned 3 values, not 2"),
        ([1, 65536], "read(holding, 7, 2) has returned 65536 for holding 8: it must be 0 to 65535"),
        ([-1, 0], "read(holding, 7, 2) has returned -1 for holding 7: it must be 0 to 65535"),
        ([1, 2.5], "read(holding, 7, 2) has returned [1, 2.5], which is no list of integers"),
        (None, "read(holding, 7, 2) has returned None, which is no list of integers"),
        ("ab", "read(holding, 7, 2) has returned 'ab', which is no list of integers"),
        ((each for each in (1, 2)), "which is no list of integers"),
    ],
)
async def test_a_wrong_result_is_04_and_said(result, said):
    bench = Bench(Returns(result))
    assert await bench.asks("03 0007 0002") == "83 04"
    (event,) = bench.failures()
    assert said in event.error
    assert (event.unit, event.device, event.traceback, event.others) == (60, "clock", "", None)


async def test_bits_are_true_or_false_and_nothing_else():
    assert await Bench(Returns([True, False, 1])).asks("01 0000 0003") == "01 01 05"
    bench = Bench(Returns([1, 0, 2]))
    assert await bench.asks("01 0000 0003") == "81 04"
    assert bench.failures()[0].error == "read(coils, 0, 3) has returned 2 for coils 2: it must be 0 to 1"


@pytest.mark.parametrize(
    ("error", "answer"), [(IllegalValue("no"), "83 03"), (Refused("odd", 5), "83 05"), (Busy(), "83 06")]
)
async def test_an_exception_that_the_unit_names_is_its_answer(error, answer):
    bench = Bench(Returns(error))
    assert await bench.asks("03 0000 0001") == answer
    assert bench.failures() == []


async def test_one_error_that_is_raised_again_and_again_keeps_nothing_of_the_calls():
    error = IllegalValue("no")
    bench = Bench(Returns(error))
    for _ in range(3):
        assert await bench.asks("03 0000 0001") == "83 03"
    assert error.__traceback__ is None


async def test_what_is_written_is_a_list_of_numbers():
    unit, taken = CustomUnit(), []

    async def write(area, address, values):
        taken.append((area, address, values))

    unit.write = write
    bench = Bench(unit)
    assert await bench.asks("06 0007 0102") == "06 00 07 01 02"
    assert await bench.asks("0F 0003 0003 01 05") == "0F 00 03 00 03"
    assert taken == [(Area.HOLDING, 7, [0x0102]), (Area.COILS, 3, [1, 0, 1])]


@pytest.mark.parametrize("code", [0, 256, "x"])
async def test_an_exception_code_that_there_is_not_is_04_and_said(code):
    bench = Bench(Returns(Refused("odd", code)))
    assert await bench.asks("03 0000 0001") == "83 04"
    assert f"Refused has the code {code}, which is no exception code" in bench.failures()[0].error
    assert await Bench(Returns(RequestError("none"))).asks("03 0000 0001") == "83 04"


class MuteError(Exception):
    """An error that cannot be shown."""

    def __str__(self) -> str:
        raise ValueError

    __repr__ = __str__


@pytest.mark.parametrize("error", [KeyError("x"), MuteError(), SystemExit(3), asyncio.CancelledError(), TimeoutError()])
async def test_any_other_error_is_04_and_an_event_with_its_traceback(error):
    bench = Bench(Returns(error))
    assert await bench.asks("03 0000 0001") == "83 04"
    (event,) = bench.failures()
    assert type(error).__name__ in event.error
    assert "in read" in event.traceback or isinstance(error, asyncio.CancelledError)
    assert await bench.asks("03 0000 0001") == "83 04"  # and it goes on


class MuteRefusal(Refused):
    """An exception response that cannot be shown."""

    def __str__(self) -> str:
        raise OSError("mute")


@pytest.mark.parametrize(
    ("error", "said"),
    [
        (MuteRefusal(), "OSError: mute"),
        (Refused("\ud800"), "UnicodeEncodeError"),
        (OSError("\ud800"), r"OSError: \ud800"),
    ],
)
async def test_an_error_that_cannot_be_told_is_04_and_told_in_words_that_can(error, said):
    bench = Bench(Returns(error))
    assert await bench.asks("03 0000 0001") == "83 04"
    (event,) = bench.failures()
    assert said in event.error
    assert f"{event.error} {event.traceback}".encode()
    assert not [each for each in bench.events if isinstance(each, PartFailed)]


async def test_a_method_that_is_no_coroutine_is_04():
    unit = CustomUnit()
    unit.read = lambda area, address, count: [0] * count
    bench = Bench(unit)
    assert await bench.asks("03 0000 0001") == "83 04"
    assert "await" in bench.failures()[0].error


async def test_failures_are_logged_once_in_a_while_with_their_number():
    bench = Bench(Returns(KeyError("x")))
    for _ in range(4):
        assert await bench.asks("03 0000 0001") == "83 04"
    assert [event.others for event in bench.failures()] == [None]
    await asyncio.sleep(LOGGED_EVERY)
    await bench.asks("03 0000 0001")
    assert [event.others for event in bench.failures()] == [None, 3]
    assert "3 other requests had failed before" in bench.failures()[1].in_words()


class Slow(CustomUnit):
    """Takes its time, and perhaps does not heed its cancellation, or fails as it ends."""

    def __init__(self, seconds: float, *, heeds: bool = True, fails: bool = False) -> None:
        self.seconds = seconds
        self.heeds = heeds
        self.fails = fails
        self.begun: list[int] = []
        self.ended: list[int] = []

    async def read(self, area, address, count):
        self.begun.append(address)
        until = asyncio.get_running_loop().time() + self.seconds
        while (left := until - asyncio.get_running_loop().time()) > 0:
            try:
                await asyncio.sleep(left)
            except asyncio.CancelledError:
                if self.fails:
                    raise KeyError("cleaning up") from None
                if self.heeds:
                    raise
        self.ended.append(address)
        return [address] * count


async def test_a_call_that_takes_too_long_is_cancelled_and_the_next_one_begins():
    unit = Slow(5.0)
    bench = Bench(unit)
    assert await bench.asks("03 0001 0001") == "83 0B"
    unit.seconds = 0.5
    assert await bench.asks("03 0002 0001") == "03 02 00 02"
    assert (unit.begun, unit.ended) == ([1, 2], [2])
    assert [type(event) for event in bench.events] == [RequestTimeout]


async def test_one_that_does_not_heed_its_cancellation_is_waited_for():
    unit = Slow(1.7, heeds=False)
    bench = Bench(unit)
    first = bench.ask("03 0001 0001")
    await asyncio.sleep(1.0)
    await asyncio.sleep(0.01)
    second = bench.ask("03 0002 0001")
    unit.seconds = 0.1
    await asyncio.sleep(1.0)
    assert (first.answers, second.answers) == (["83 0B"], ["03 02 00 02"])
    assert unit.begun == unit.ended == [1, 2]


async def test_an_error_after_the_deadline_is_told_and_answers_nobody():
    bench = Bench(Slow(5.0, fails=True))
    assert await bench.asks("03 0001 0001") == "83 0B"
    await asyncio.sleep(0.01)
    assert [event.error for event in bench.failures()] == ["KeyError: 'cleaning up'"]


async def test_closed_in_a_call_it_is_cancelled_and_over():
    unit = Slow(5.0)
    bench = Bench(unit)
    client = bench.ask("03 0001 0001")
    await asyncio.sleep(0.1)
    bench.driver.close()
    assert (client.answers, bench.driver.is_busy) == (["83 0B"], True)
    await asyncio.sleep(0.01)
    assert not bench.driver.is_busy
    assert asyncio.all_tasks() == {asyncio.current_task()}


async def test_the_task_of_a_call_may_be_cancelled_by_the_program():
    """As asyncio.run does at its end with all tasks."""
    bench = Bench(Slow(0.5))
    client = bench.ask("03 0001 0001")
    await asyncio.sleep(0.1)
    (task,) = asyncio.all_tasks() - {asyncio.current_task()}
    task.cancel()
    with suppress(asyncio.CancelledError):
        await task
    await asyncio.sleep(0.01)
    assert client.answers == ["83 04"]


async def test_a_unit_that_asks_itself_gets_no_answer_and_the_next_client_does():
    class Narcissus(CustomUnit):
        async def read(self, area, address, count):
            if address == 9:
                inner = bench.ask("03 0001 0001")
                await asyncio.sleep(10.0)
                assert not inner.answers
            return [address] * count

    bench = Bench(Narcissus())
    assert await bench.asks("03 0009 0001") == "83 0B"
    assert await bench.asks("03 0002 0001") == "03 02 00 02"


async def test_without_a_thread_its_clients_get_04():
    def there(*_) -> None:
        raise RuntimeError("can't start new thread")

    bench = Bench(Registers())
    bench.driver._there = there
    assert await bench.asks("03 0003 0001") == "83 04"
    assert "can't start new thread" in bench.failures()[0].error


@pytest.mark.interpreted
async def test_a_defect_in_the_image_is_told_and_ends_only_its_request(monkeypatch):
    bench = Bench(Registers())
    with monkeypatch.context() as patched:
        patched.setattr(bench.driver.image, "_advance", lambda *_: 1 / 0)
        assert await bench.asks("03 0003 0001") == "83 04"
    assert [type(event) for event in bench.events] == [PartFailed]
    assert await bench.asks("03 0003 0001") == "03 02 00 03"


class Late(CustomUnit):
    """Returns after its cancellation, as if there had been none."""

    def __init__(self) -> None:
        self.cancelled: list[int] = []

    async def read(self, area, address, count):
        try:
            await asyncio.sleep(0.3)
        except asyncio.CancelledError:
            self.cancelled.append(address)
            await asyncio.sleep(0.1)
        return [address] * count


async def test_a_call_that_ends_after_a_defect_is_no_answer_to_the_next_request():
    unit = Late()
    bench = Bench(unit)
    first = bench.ask("03 0001 0001")
    await asyncio.sleep(0.1)
    bench.driver._run(lambda _: 1 / 0)
    assert first.answers == ["83 04"]
    assert await bench.asks("03 0002 0001") == "03 02 00 02"
    assert (first.answers, unit.cancelled) == (["83 04"], [1])


@pytest.mark.interpreted
async def test_nor_does_a_defect_in_its_answer_leave_a_client_waiting(monkeypatch):
    bench = Bench(Returns(IllegalValue("no")))
    with monkeypatch.context() as patched:
        patched.setattr(bench.driver.image, "_tell", lambda *_: 1 / 0)
        assert await bench.asks("03 0003 0001") == "83 04"
    assert [type(event) for event in bench.events] == [PartFailed]
    assert await bench.asks("03 0003 0001") == "83 03"


async def test_calls_leave_no_references_behind():
    unit = Registers()
    bench = Bench(unit)
    await bench.asks("03 0003 0001")
    before = sys.getrefcount(unit)
    for _ in range(20):
        await bench.asks("03 0003 0001")
    assert sys.getrefcount(unit) == before


class OfItsAuthor(IllegalAddress):
    """An error that has what ours have, with another meaning."""

    code = 7

    def __init__(self, result: object) -> None:
        super().__init__(f"not {result}")
        self.result = result


@pytest.mark.parametrize(("code", "kind"), [(7, Refused), (2, IllegalAddress)])
async def test_an_error_of_its_authors_own_class_is_told_as_one_of_ours(code, kind):
    error = OfItsAuthor({"a": 1})
    error.code = code
    client = Asker()
    bench = Bench(Returns(error))
    asked = client.ask("03 0000 0001", unit=60, now=bench.loop.time())
    bench.driver.image.submit(asked, bench.loop.time())
    await asyncio.sleep(0.1)
    assert client.answers == [f"83 {code:02X}"]
    assert type(asked.error) is kind
    assert (str(asked.error), asked.error.result) == ("not {'a': 1}", kind.result)


@pytest.mark.parametrize("kind", [IllegalAddress, ValueError])
async def test_long_texts_of_errors_are_not_kept(kind):
    bench, client = Bench(Returns(kind("x" * 10**6))), Asker()
    asked = client.ask("03 0000 0001", unit=60, now=bench.loop.time())
    bench.driver.image.submit(asked, bench.loop.time())
    await asyncio.sleep(0.1)
    assert asked.error is not None
    assert len(str(asked.error)) < 500
    assert sum(len(repr(event)) for event in bench.events) < 25_000
