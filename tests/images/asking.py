"""A client for images: it asks in hexadecimal, and insists on exactly one answer, at once."""

from gateway.images.image import Image, ImageSettings
from gateway.modbus.codes import BROADCAST_UNIT, Area
from gateway.profiles.profile import Profile
from gateway.request import Caller, Origin, Request, Target
from gateway.routing.broadcast import Broadcast, Recipient

UNIT = 10
GENERIC = Profile("generic")
#: The built-in profile's rules that matter to an image.
MINT = Profile(
    "mint",
    functions=frozenset({1, 2, 3, 5, 16, 23}),
    limits={3: 99},
    areas={Area.HOLDING: ((1, 99),)},
)


class Answers(Origin):
    """The origin of the requests; keeps what comes back, None for a request that ended without a response."""

    def __init__(self) -> None:
        self.caller = Caller("test", "127.0.0.1", "127.0.0.1")
        self.came: list[bytes | None] = []

    def wants(self, request: Request) -> bool:
        return True

    def answer(self, request: Request, pdu: bytes | None) -> None:
        self.came.append(pdu)


def image(profile: Profile = GENERIC, initial=None, **areas: tuple[tuple[int, int], ...]) -> Image:
    """An image with these addresses, such as `holding=((0, 9),)`."""
    ranges = {Area(name): ranges for name, ranges in areas.items()}
    return Image(ImageSettings(UNIT, "shift-data", profile, ranges, initial or {}))


def exchange(target: Target, pdu: bytes, unit: int = UNIT) -> bytes | None:
    """The one thing that `target` did with the request: its response, or None for none."""
    answers = Answers()
    target.submit(Request(unit, pdu, answers, received_at=0.0), now=0.0)
    assert len(answers.came) == 1
    return answers.came[0]


def ask(image: Image, pdu: str) -> str:
    """The response to a request, both as hexadecimal text; spaces as the reader likes them."""
    response = exchange(image, bytes.fromhex(pdu))
    assert response is not None
    return response.hex(" ").upper()


def broadcast(image: Image, pdu: str) -> None:
    """Ask unit 0, behind which only `image` is."""
    exchange(Broadcast([Recipient(image)]), bytes.fromhex(pdu), BROADCAST_UNIT)


def contents(image: Image) -> dict[Area, list[tuple[int, ...]]]:
    """Every value of `image`, range by range."""
    return {
        area: [table.values(first, last + 1 - first) for first, last in table.ranges]
        for area, table in image.tables.items()
    }
