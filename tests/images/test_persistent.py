"""When a write to a persistent image is answered, what a disk that refuses leaves behind, and what a successor has."""

import pytest

from gateway.images.image import ImageSettings
from gateway.images.persistent import Change, PersistentImage
from gateway.modbus.codes import Area
from gateway.request import Caller, Origin, Request
from images.asking import GENERIC
from images.disk import Disk


class Client(Origin):
    def __init__(self, image: PersistentImage, client: str = "10.0.0.9:1") -> None:
        self.caller = Caller(client, "127.0.0.1", "127.0.0.1")
        self.came: list[str] = []
        self._image = image

    def wants(self, request: Request) -> bool:
        return True

    def answer(self, request: Request, pdu: bytes | None) -> None:
        self.came.append("" if pdu is None else pdu.hex(" ").upper())

    def ask(self, pdu: str) -> None:
        self._image.submit(Request(10, bytes.fromhex(pdu), self, received_at=0.0), now=0.0)

    def take(self) -> list[str]:
        came, self.came = self.came, []
        return came


def persistent(disk, persist="always", holding=10, initial_holding=()) -> PersistentImage:
    areas = {Area.HOLDING: ((0, holding - 1),), Area.COILS: ((0, 15),)}
    initial = {Area.HOLDING: initial_holding}
    image = PersistentImage(ImageSettings(10, "shift-data", GENERIC, areas, initial, persist), disk)
    image.start()
    return image


def test_a_write_is_answered_once_it_is_kept():
    disk = Disk()
    client = Client(persistent(disk))
    client.ask("06 0001 BEEF")
    assert client.take() == []
    assert disk.changes[0][0] == Change("shift-data", Area.HOLDING, 1, (0xBEEF,))
    disk.keep()
    assert client.take() == ["06 00 01 BE EF"]


def test_a_keeper_that_is_done_at_once_answers_at_once():
    client = Client(persistent(Disk(), "interval"))
    client.ask("10 0001 0002 04 0001 0002")
    client.ask("03 0001 0002")
    assert client.take() == ["10 00 01 00 02", "03 04 00 01 00 02"]


def test_every_writing_function_tells_what_it_has_changed():
    disk = Disk(holding={0: 0x0012})
    client = Client(persistent(disk))
    for pdu in ("05 0003 FF00", "0F 0000 0003 01 05", "16 0000 00F2 0025", "17 0000 0001 0004 0002 04 0007 0008"):
        client.ask(pdu)
    assert [change[1:] for change, _ in disk.changes] == [
        (Area.COILS, 3, (1,)),
        (Area.COILS, 0, (1, 0, 1)),
        (Area.HOLDING, 0, (0x17,)),
        (Area.HOLDING, 4, (7, 8)),
    ]


def test_what_the_writer_asks_meanwhile_is_answered_behind_its_write_and_others_do_not_wait():
    disk = Disk()
    image = persistent(disk)
    writer, reader = Client(image), Client(image, "10.0.0.8:1")
    writer.ask("06 0001 0007")
    writer.ask("03 0001 0001")
    writer.ask("03 0063 0001")
    reader.ask("03 0001 0001")
    assert (writer.take(), reader.take()) == ([], ["03 02 00 07"])
    disk.keep()
    assert writer.take() == ["06 00 01 00 07", "03 02 00 07", "83 02"]


def test_writes_are_answered_in_their_order():
    disk = Disk()
    image = persistent(disk)
    one, other = Client(image), Client(image, "10.0.0.8:1")
    one.ask("06 0001 0001")
    other.ask("06 0001 0002")
    other.ask("03 0001 0001")
    disk.keep()
    assert (one.take(), other.take()) == (["06 00 01 00 01"], [])
    disk.keep()
    assert other.take() == ["06 00 01 00 02", "03 02 00 02"]


def test_a_disk_that_refuses_undoes_every_write_since_the_last_one_that_was_kept():
    disk = Disk(holding={1: 5})
    image = persistent(disk)
    one, other = Client(image), Client(image, "10.0.0.8:1")
    one.ask("06 0001 0006")
    disk.keep()
    one.ask("06 0001 0007")
    other.ask("06 0001 0008")
    other.ask("03 0001 0001")
    one.ask("05 0000 FF00")
    disk.fail()
    assert one.take() == ["06 00 01 00 06", "86 04", "85 04"]
    assert other.take() == ["86 04", "03 02 00 06"]
    one.ask("01 0000 0001")
    assert one.take() == ["01 01 00"]


def test_it_goes_on_when_the_disk_does():
    disk = Disk()
    client = Client(persistent(disk))
    client.ask("06 0001 0007")
    disk.fail()
    client.ask("06 0001 0008")
    disk.keep()
    client.ask("03 0001 0001")
    assert client.take() == ["86 04", "06 00 01 00 08", "03 02 00 08"]


def test_a_request_that_is_refused_keeps_nothing():
    disk = Disk()
    client = Client(persistent(disk))
    client.ask("06 0063 0001")
    client.ask("10 0000 0001 02")
    assert (client.take(), disk.changes) == (["86 02", "90 03"], [])


def test_kept_values_replace_initial_ones_and_those_without_a_place_are_passed_over():
    disk = Disk(holding={1: 7, 10: 9}, input={0: 9}, coils={2: 1})
    client = Client(persistent(disk, initial_holding=((0, (1, 2, 3)),)))
    client.ask("03 0000 0003")
    client.ask("01 0000 0003")
    assert client.take() == ["03 06 00 01 00 07 00 03", "01 01 04"]


def test_what_is_undone_goes_back_to_its_initial_value():
    disk = Disk()
    client = Client(persistent(disk, initial_holding=((0, (1, 2, 3)),)))
    client.ask("06 0001 0007")
    disk.fail()
    client.ask("03 0000 0003")
    assert client.take() == ["86 04", "03 06 00 01 00 02 00 03"]


# --- an image that takes the place of another ------------------------------------------------------


def test_a_successor_has_what_is_not_kept_yet():
    disk = Disk()
    client, reader = Client(persistent(disk)), Client(persistent(disk, "interval"))
    client.ask("06 0001 0007")
    successor = Client(persistent(disk, "interval"))
    successor.ask("03 0001 0001")
    reader.ask("03 0001 0001")
    assert (client.take(), successor.take(), reader.take()) == ([], ["03 02 00 07"], ["03 02 00 00"])
    disk.keep(2)
    assert client.take() == ["06 00 01 00 07"]


@pytest.mark.parametrize("persist", ["interval", "always"])
def test_what_is_undone_is_undone_in_a_successor_too(persist):
    disk = Disk(holding={1: 5})
    client = Client(persistent(disk))
    client.ask("06 0001 0007")
    client.ask("03 0001 0001")
    successor = Client(persistent(disk, persist))
    disk.fail()
    successor.ask("03 0001 0001")
    assert (client.take(), successor.take()) == (["86 04", "03 02 00 05"], ["03 02 00 05"])


def test_writes_to_a_successor_fail_with_those_before_them():
    disk = Disk(holding={1: 5})
    client = Client(persistent(disk))
    client.ask("06 0001 0007")
    successor = Client(persistent(disk))
    successor.ask("16 0001 FFFF 0008")
    successor.ask("03 0001 0001")
    disk.fail()
    assert (client.take(), successor.take()) == (["86 04"], ["96 04", "03 02 00 05"])


def test_a_value_outlives_an_image_that_had_no_place_for_it():
    disk = Disk()
    first = Client(persistent(disk, "interval"))
    first.ask("06 0008 0063")
    persistent(disk, "interval", holding=5)
    third = Client(persistent(disk, "interval"))
    third.ask("03 0008 0001")
    assert third.take() == ["03 02 00 63"]


def test_an_image_that_goes_on_serving_starts_only_once():
    disk = Disk()
    image = persistent(disk, "interval")
    tables = image.tables
    image.start()
    assert image.tables is tables


def test_requests_and_exceptions_are_counted():
    disk = Disk()
    image = persistent(disk)
    client = Client(image)
    client.ask("06 0001 0007")
    client.ask("03 0063 0001")
    disk.fail()
    assert (image.counts.requests, image.counts.exceptions) == (2, 2)
