"""The gateway at work, as operations see it."""

from gateway.runtime.reload import Reloader
from gateway.runtime.running import Running


class Operator:
    """What operations are asked of: the `running` gateway, and what reads its config again."""

    def __init__(self, running: Running, reloader: Reloader) -> None:
        self.running = running
        self.reloader = reloader
