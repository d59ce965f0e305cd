"""A daemon without a process: one image and its points, behind the words of the control socket."""

import json
from collections.abc import Iterable
from pathlib import Path
from typing import Any, Self

from gateway.cli.kit.daemon import Meant
from gateway.control.server import _line
from gateway.errors import DaemonError
from gateway.images.image import Image, ImageSettings
from gateway.modbus.codes import Area
from gateway.operator.answers.unit import UnitPicture
from gateway.operator.requests import AT_CONTROL
from gateway.profiles.point import Point
from gateway.profiles.profile import Profile
from gateway.request import Request

PROFILE = Profile("generic", limits={3: 4})


class FakeDaemon:
    """Stands in for `Conversation`. `asked` are the requests that came, `silent` what the gateway says of them."""

    caller = AT_CONTROL
    gateway = Path("/run/gw.sock")

    def __init__(self, points: Iterable[Point] = (), *, functions: tuple[int, ...] | None = None) -> None:
        settings = ImageSettings(41, "silo-1", PROFILE, dict.fromkeys(Area, ((0, 19),)))
        self.image = Image(settings)
        self.asked: list[str] = []
        self.silent: dict[str, str] = {}
        self._picture = UnitPicture(
            41, "silo-1", "device", "weigher", functions, PROFILE.limits, {}, 3400.0, (*points,)
        )
        self._answer = b""

    def __call__(self, meant: Meant) -> Self:
        return self

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        pass

    def wait_for(self, seconds: float) -> None:
        assert seconds > 3.4

    def ask(self, verb: str, **details: Any) -> dict[str, Any]:
        """As the daemon answers, in JSON and back."""
        if verb == "unit" and details["unit"] not in (41, "silo-1"):
            raise DaemonError(f'the gateway says: nothing has the name "{details["unit"]}"')
        answer = {"unit": self._picture} if verb == "unit" else self._request(**details)
        return json.loads(_line({"ok": True, **answer}))

    def _request(self, unit: int, pdu: str) -> dict[str, Any]:
        self.asked.append(pdu.upper())
        if self.silent:
            return {"unit": unit, "pdu": f"{int(pdu[:2], 16) | 0x80:02X} 0B", "elapsed_ms": 12.5, **self.silent}
        self.image.submit(Request(unit, bytes.fromhex(pdu), self, 0.0), 0.0)
        return {"unit": unit, "pdu": self._answer.hex(" "), "elapsed_ms": 12.5}

    def wants(self, request: Request) -> bool:
        return True

    def answer(self, request: Request, pdu: bytes | None) -> None:
        self._answer = pdu or b""
