"""Where a request waits, in place of the queue of a line."""

from gateway.request import Request


class Waiting:
    """The place of `request`. `is_given_up` once it was told so."""

    def __init__(self, request: Request) -> None:
        request.place = self
        self.is_given_up = False

    def give_up(self) -> None:
        self.is_given_up = True
