"""Daemons without a process, behind the words of the control socket."""

import io
import json
from collections.abc import Callable, Iterable, Iterator, Mapping
from pathlib import Path
from typing import Any, Self

from gateway.cli.kit.daemon import Conversation, Meant
from gateway.control.messages import END
from gateway.control.server import _line
from gateway.errors import DaemonError
from gateway.images.image import Image, ImageSettings
from gateway.modbus.codes import Area
from gateway.operator.operations.answers.unit import RequestAnswer, UnitPicture
from gateway.operator.operations.parameters import fields_of, read_parameters
from gateway.operator.operations.table import BY_NAME
from gateway.operator.values.requests import AT_CONTROL
from gateway.profiles.point import Point
from gateway.profiles.profile import Profile, Range
from gateway.request import Request
from gateway.version import __version__

Question = Mapping[str, Any]


class FakeConversation(Conversation):
    """A conversation without a gateway: `answers` are found by a function of the question. `questions` are kept."""

    pid = 1

    def __init__(self, answers: Callable[[Question], Iterable[Mapping[str, Any]]]) -> None:
        self.gateway = Path("/run/gw.sock")
        self.questions: list[Question] = []
        self.meant: Meant | None = None
        self._answers = answers
        self._version = __version__
        self._coming: Iterator[Mapping[str, Any]] = iter(())
        self._stream = self._sock = io.BytesIO()  # type: ignore[assignment]

    def __call__(self, meant: Meant) -> Self:
        self.meant = meant
        return self

    def wait_for(self, seconds: float) -> None:
        assert seconds > 2

    def _send(self, question: Question) -> None:
        read_parameters(BY_NAME[question["verb"]].parameters, question)  # as the gateway does
        self.questions.append(question)
        self._coming = iter([*self._answers(question), END])

    def _receive(self) -> dict[str, Any]:
        """As the gateway answers, in JSON and back."""
        return json.loads(_line({"ok": True, **next(self._coming)}))


def telling(*answers: Mapping[str, Any]) -> FakeConversation:
    """A gateway that gives these answers to every question."""
    return FakeConversation(lambda question: answers)


PROFILE = Profile("generic", limits={3: 4})


class FakeDaemon(FakeConversation):
    """One image and its points. `asked` are the requests that came, `silent` what the gateway says of them."""

    caller = AT_CONTROL

    def __init__(
        self,
        points: Iterable[Point] = (),
        *,
        functions: tuple[int, ...] | None = None,
        wide: Mapping[str, tuple[Range, ...]] | None = None,
        max_gap: int = 0,
        ranges: tuple[tuple[int, int], ...] = ((0, 19),),
    ) -> None:
        super().__init__(self._answer_to)
        settings = ImageSettings(41, "silo-1", PROFILE, dict.fromkeys(Area, ranges))
        self.image = Image(settings)
        self.asked: list[str] = []
        self.silent: dict[str, str] = {}
        self._picture = UnitPicture(
            41,
            "silo-1",
            "device",
            "weigher",
            functions,
            PROFILE.limits,
            {},
            3400.0,
            (*points,),
            max_gap=max_gap,
            wide=wide or {},
        )
        self._answer = b""

    def _answer_to(self, question: Question) -> list[Mapping[str, Any]]:
        if question["verb"] == "unit" and question["unit"] not in (41, "silo-1"):
            raise DaemonError(f'the gateway says: nothing has the name "{question["unit"]}"')
        if question["verb"] == "unit":
            return [{"unit": self._picture}]
        return [fields_of(self._request(question["unit"], question["pdu"]))]

    def _request(self, unit: int, pdu: str) -> RequestAnswer:
        self.asked.append(pdu.upper())
        if self.silent:
            return RequestAnswer(unit, f"{int(pdu[:2], 16) | 0x80:02X} 0B", 12.5, **self.silent)
        self.image.submit(Request(unit, bytes.fromhex(pdu), self, 0.0), 0.0)
        return RequestAnswer(unit, self._answer.hex(" "), 12.5)

    def wants(self, request: Request) -> bool:
        return True

    def answer(self, request: Request, pdu: bytes | None) -> None:
        self._answer = pdu or b""
