"""The report of an adapter: what is tried, what is sent, and what is said of it."""

import asyncio

import pytest

from gateway.errors import PortClosed, PortError
from gateway.modbus.rtu import with_crc
from gateway.ports.port import CharacterErrors, SerialSettings
from gateway.timing.characters import CharacterFormat
from gateway.tools.hardware_report import RATES, READS, look_at, read_for, wait_for_loss, wait_for_return

SETTINGS = SerialSettings("/dev/ttyUSB7", 9600, CharacterFormat(8, "E", 1))
ANSWER = with_crc(b"\x05\x03\x02\x00\x07")
QUESTION = with_crc(b"\x05\x03\x00\x00\x00\x01")


class Adapter:
    """A port that a test plugs in: `pieces` of an answer come 10 ms after each request and 5 ms after each other."""

    latency, is_virtual = 0.005, False

    def __init__(self):
        self.opened, self.written, self.is_open = [], [], False
        self.pieces, self.errors, self.damaged = [ANSWER], None, False
        self.refused = {}  # by rate, format or "kernel"

    def open_with(self, settings):
        async def open_port(user):
            assert not self.is_open
            for key in (settings.baud, str(settings.format), settings.rs485):
                if key in self.refused:
                    raise PortError(self.refused[key])
            self.opened.append(settings)
            self.user, self.is_open = user, True
            self.baud = {100000: 101010}.get(settings.baud, settings.baud)
            return self

        return open_port

    def write(self, data):
        self.written.append(data)
        for number, piece in enumerate(self.pieces):
            asyncio.get_running_loop().call_later(0.010 + 0.005 * number, self._deliver, piece)

    def _deliver(self, piece):
        self.user.received(piece, damaged=self.damaged)

    def change_baud(self, baud):
        if "change" in self.refused:
            self.user.lost(PortError(self.refused["change"]))

    def close(self):
        self.is_open = False
        self.user.lost(PortClosed())

    async def wait_closed(self):
        pass


@pytest.fixture
def adapter():
    return Adapter()


async def rows_of(adapter, title, unit=None):
    sections = await look_at(adapter.open_with, SETTINGS, unit)
    return dict(next(rows for name, rows in sections if name == title))


async def test_without_a_unit_nothing_is_sent_and_the_port_is_free_again(adapter):
    await look_at(adapter.open_with, SETTINGS, None)
    assert (adapter.written, adapter.is_open) == ([], False)


async def test_rates_and_formats_as_the_driver_takes_them(adapter):
    adapter.refused = {921600: "its driver set 115200 instead", "7E1": "its driver set another format"}
    rates = await rows_of(adapter, "Rates")
    assert list(rates) == [str(rate) for rate in RATES]
    assert rates["19200"] == "yes"
    assert rates["100000"] == "yes, as 101010"
    assert rates["921600"] == "no: its driver set 115200 instead"
    formats = await rows_of(adapter, "Formats")
    assert (formats["8N1"], formats["7E1"]) == ("yes", "no: its driver set another format")


async def test_what_the_driver_has(adapter):
    adapter.refused = {"kernel": "/dev/ttyUSB7 has no RS-485 support in its driver"}
    adapter.errors = CharacterErrors(0, 0, 0, 0)
    rows = await rows_of(adapter, "Driver")
    assert rows["opens at"] == "9600 baud, 8E1"
    assert rows["counts wrong characters"] == "yes"
    assert rows["changes its rate while open"] == "yes"
    assert rows["RS-485 in the driver"] == "no: the port has no RS-485 support in its driver"


async def test_a_rate_that_cannot_be_changed(adapter):
    adapter.refused = {"change": "its driver refuses"}
    assert (await rows_of(adapter, "Driver"))["changes its rate while open"] == "its driver refuses"


async def test_a_unit_that_answers_in_pieces(adapter):
    adapter.pieces = [ANSWER[:3], ANSWER[3:]]
    rows = await rows_of(adapter, "Unit 5", unit=5)
    assert adapter.written == [QUESTION] * READS
    assert rows["reads"] == "20: 20 answered, 0 damaged, 0 silent"
    assert rows["until the first byte"] == "10.0 to 10.0 ms, median 10.0 ms"
    assert rows["until the last byte"] == "15.0 to 15.0 ms, median 15.0 ms"
    assert (rows["pieces of an answer"], rows["echo"]) == ("2 at most", "none")
    assert rows["the driver counted"] == "nothing: it does not count"


async def test_an_exception_is_an_answer(adapter):
    adapter.pieces = [with_crc(b"\x05\x83\x02")]
    assert dict(await read_for(adapter.open_with, SETTINGS, 5, count=1))["reads"].startswith("1: 1 answered")


@pytest.mark.parametrize("pieces", [[QUESTION, ANSWER], [QUESTION + ANSWER], [QUESTION[:5], QUESTION[5:] + ANSWER]])
async def test_an_echo_is_not_the_answer(adapter, pieces):
    adapter.pieces = pieces
    rows = dict(await read_for(adapter.open_with, SETTINGS, 5, count=2))
    assert rows["reads"].startswith("2: 2 answered")
    assert rows["echo"].startswith("yes")
    assert rows["pieces of an answer"] == "1 at most"


async def test_an_echo_and_nothing_else(adapter):
    adapter.pieces = [QUESTION]
    rows = dict(await read_for(adapter.open_with, SETTINGS, 5, count=1))
    assert rows["reads"] == "1: 0 answered, 0 damaged, 1 silent"
    assert rows["echo"].startswith("yes")


@pytest.mark.parametrize("marked", [True, False])
async def test_damaged_answers_and_what_the_driver_counted(adapter, marked):
    adapter.damaged, adapter.errors = marked, CharacterErrors(12, 1, 2, 3)
    adapter.pieces = [ANSWER] if marked else [ANSWER[:-1] + b"\x00"]
    rows = dict(await read_for(adapter.open_with, SETTINGS, 5, count=2))
    assert rows["reads"] == "2: 0 answered, 2 damaged, 0 silent"
    assert rows["the driver counted"] == "12 characters, 1 without a stop bit, 2 of wrong parity, 3 lost"


async def test_it_reads_for_a_while(adapter):
    adapter.pieces = []
    begin = asyncio.get_running_loop().time()
    rows = dict(await read_for(adapter.open_with, SETTINGS, 5, seconds=10))
    assert rows["reads"] == "10: 0 answered, 0 damaged, 10 silent"
    assert asyncio.get_running_loop().time() - begin < 12


async def test_a_port_that_is_lost_during_the_reads(adapter):
    adapter.pieces = []
    asyncio.get_running_loop().call_later(0.5, lambda: adapter.user.lost(PortError("it is gone")))
    assert dict(await read_for(adapter.open_with, SETTINGS, 5, count=9))["the port was lost"] == "it is gone"


async def test_unplugging_is_noticed_and_so_is_the_return(adapter):
    def unplug():
        adapter.refused = {9600: "does not exist"}
        adapter.user.lost(PortError("it is gone: unplugged"))

    loop = asyncio.get_running_loop()
    lost = await wait_for_loss(adapter.open_with, SETTINGS, lambda: loop.call_later(5, unplug))
    assert lost == ("unplugged", "noticed: it is gone: unplugged")
    loop.call_later(5, adapter.refused.clear)
    assert await wait_for_return(adapter.open_with, SETTINGS) == ("plugged in again", "opened, as ttyUSB7")


async def test_nobody_unplugs_and_nothing_comes_back(adapter):
    assert (await wait_for_loss(adapter.open_with, SETTINGS, lambda: None)).seen == "not noticed"
    adapter.refused = {9600: "does not exist"}
    assert (await wait_for_return(adapter.open_with, SETTINGS)).seen == "not opened: does not exist"


async def test_a_port_that_cannot_be_opened_is_an_error(adapter):
    adapter.refused = {9600: "held by another program"}
    with pytest.raises(PortError, match="held by"):
        await look_at(adapter.open_with, SETTINGS, None)


async def test_the_path_of_the_port_which_may_tell_a_serial_number_is_nowhere_in_the_report(adapter):
    message = f"{SETTINGS.port} refuses this"
    adapter.refused = {"kernel": message, "change": message, 1200: message, "7E1": message}
    sections = await look_at(adapter.open_with, SETTINGS, 5)
    assert SETTINGS.port not in str(sections)
    assert str(sections).count("the port refuses this") == 4
    loop = asyncio.get_running_loop()
    lost = await wait_for_loss(
        adapter.open_with, SETTINGS, lambda: loop.call_later(5, lambda: adapter.user.lost(PortError(message)))
    )
    adapter.refused = {9600: message}
    assert SETTINGS.port not in str([lost, await wait_for_return(adapter.open_with, SETTINGS)])
