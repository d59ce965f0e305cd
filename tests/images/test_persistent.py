"""When a write to a persistent image is answered, and what a disk that refuses leaves behind."""

from gateway.images.image import ImageSettings
from gateway.images.persistent import Change, PersistentImage
from gateway.modbus.codes import Area
from gateway.request import Request
from images.asking import GENERIC


class Disk:
    """Keeps changes when the test says so."""

    def __init__(self) -> None:
        self.changes = []

    def commit(self, change, done) -> None:
        self.changes.append((change, done))

    def keep(self, count: int = 1, *, well: bool = True) -> None:
        for _ in range(count):
            _, done = self.changes.pop(0)
            done(well)


class Client:
    host = "127.0.0.1"

    def __init__(self, image: PersistentImage, client: str = "10.0.0.9:1") -> None:
        self.client = client
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


def persistent(commit, kept=(), **initial) -> PersistentImage:
    areas = {Area.HOLDING: ((0, 9),), Area.COILS: ((0, 15),)}
    settings = ImageSettings(10, "shift-data", GENERIC, areas, {Area(name): rows for name, rows in initial.items()})
    return PersistentImage(settings, kept, commit)


def at_once(change, done) -> None:
    done(True)


def test_a_write_is_answered_once_it_is_kept():
    disk = Disk()
    client = Client(persistent(disk.commit))
    client.ask("06 0001 BEEF")
    assert client.take() == []
    assert disk.changes[0][0] == Change("shift-data", Area.HOLDING, 1, (0xBEEF,))
    disk.keep()
    assert client.take() == ["06 00 01 BE EF"]


def test_a_keeper_that_is_done_at_once_answers_at_once():
    client = Client(persistent(at_once))
    client.ask("10 0001 0002 04 0001 0002")
    client.ask("03 0001 0002")
    assert client.take() == ["10 00 01 00 02", "03 04 00 01 00 02"]


def test_every_writing_function_tells_what_it_has_changed():
    disk = Disk()
    client = Client(persistent(disk.commit, holding=((0, (0x0012,)),)))
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
    image = persistent(disk.commit)
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
    image = persistent(disk.commit)
    one, other = Client(image), Client(image, "10.0.0.8:1")
    one.ask("06 0001 0001")
    other.ask("06 0001 0002")
    other.ask("03 0001 0001")
    disk.keep()
    assert (one.take(), other.take()) == (["06 00 01 00 01"], [])
    disk.keep()
    assert other.take() == ["06 00 01 00 02", "03 02 00 02"]


def test_a_disk_that_refuses_undoes_every_write_since_the_last_one_that_was_kept():
    disk = Disk()
    image = persistent(disk.commit, holding=((1, (5,)),))
    one, other = Client(image), Client(image, "10.0.0.8:1")
    one.ask("06 0001 0006")
    disk.keep()
    one.ask("06 0001 0007")
    other.ask("06 0001 0008")
    other.ask("03 0001 0001")
    one.ask("05 0000 FF00")
    disk.keep(3, well=False)
    assert one.take() == ["06 00 01 00 06", "86 04", "85 04"]
    assert other.take() == ["86 04", "03 02 00 06"]
    one.ask("01 0000 0001")
    assert one.take() == ["01 01 00"]


def test_it_goes_on_when_the_disk_does():
    disk = Disk()
    client = Client(persistent(disk.commit))
    client.ask("06 0001 0007")
    disk.keep(well=False)
    client.ask("06 0001 0008")
    disk.keep()
    client.ask("03 0001 0001")
    assert client.take() == ["86 04", "06 00 01 00 08", "03 02 00 08"]


def test_a_request_that_is_refused_keeps_nothing():
    disk = Disk()
    client = Client(persistent(disk.commit))
    client.ask("06 0063 0001")
    client.ask("10 0000 0001 02")
    assert (client.take(), disk.changes) == (["86 02", "90 03"], [])


def test_kept_values_replace_initial_ones_and_those_without_a_place_are_passed_over():
    kept = [(Area.HOLDING, (1, (7,))), (Area.HOLDING, (10, (9,))), (Area.INPUT, (0, (9,))), (Area.COILS, (2, (1,)))]
    client = Client(persistent(at_once, kept, holding=((0, (1, 2, 3)),)))
    client.ask("03 0000 0003")
    client.ask("01 0000 0003")
    assert client.take() == ["03 06 00 01 00 07 00 03", "01 01 04"]


def test_requests_and_exceptions_are_counted():
    disk = Disk()
    image = persistent(disk.commit)
    client = Client(image)
    client.ask("06 0001 0007")
    client.ask("03 0063 0001")
    disk.keep(well=False)
    assert (image.counts.requests, image.counts.exceptions) == (2, 2)
