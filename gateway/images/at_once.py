"""What the gateway answers itself, as something that is polled."""

from gateway.profiles.holes import Holes
from gateway.request import Request, Target


class AtOnce(Target):
    """An image, a mirror or a virtual unit that is polled: nobody waits for it, and it never backs off."""

    def __init__(self, destination: Target) -> None:
        self.holes = Holes()
        self.destination = destination

    def submit(self, request: Request, now: float, *, yields: bool = False) -> None:  # noqa: ARG002 - nobody waits
        """See PolledTarget."""
        self.destination.submit(request, now)

    def is_resting(self, now: float) -> bool:  # noqa: ARG002 - at any time
        """See PolledTarget."""
        return False
