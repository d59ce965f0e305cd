"""A Target for a bench that is an Origin too: no compiled class is both."""

from collections.abc import Callable

from gateway.request import Request, Target


class CallingTarget(Target):
    """Calls `submit` with each request."""

    def __init__(self, submit: Callable[..., None]) -> None:
        self._submit = submit

    def submit(self, request: Request, now: float, *, yields: bool = False) -> None:
        self._submit(request, now, yields=yields)
