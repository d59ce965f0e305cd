"""A Target made of a function. A bench that is an Origin needs one: no compiled class is both."""

from collections.abc import Callable
from typing import Any

from gateway.request import NamedTarget, Request


class CallingTarget(NamedTarget):
    """Calls `submit` with each request."""

    def __init__(self, submit: Callable[..., None], name: str = "") -> None:
        self.name = name
        self._submit = submit

    def submit(self, request: Request, now: float, **more: Any) -> None:
        self._submit(request, now, **more)
