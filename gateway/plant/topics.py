"""The topics of messages: plain ones, `modbus/SITE/DEVICE` and those below it, and those of Sparkplug B."""

from dataclasses import dataclass
from typing import Final

_ROOT: Final = "modbus"
_NAMESPACE: Final = "spBv1.0"


@dataclass(frozen=True, slots=True)
class Topics:
    """The topics of a site."""

    site: str

    @property
    def status(self) -> str:
        """Whether the gateway is connected."""
        return f"{_ROOT}/{self.site}/status"

    def values(self, device: str) -> str:
        """The last values of a device."""
        return f"{_ROOT}/{self.site}/{device}"

    def availability(self, device: str) -> str:
        """Whether a device answers."""
        return self.availability_of(self.values(device))

    @staticmethod
    def availability_of(values: str) -> str:
        """Whether a device answers, by the topic of its last values."""
        return f"{values}/availability"

    def setting(self, device: str, point: str) -> str:
        """Takes values for a point."""
        return f"{self.values(device)}/{point}/set"

    @property
    def settings(self) -> str:
        """The filter for all that takes values."""
        return self.setting("+", "+")

    def named(self, setting: str) -> tuple[str, str] | None:
        """The names of device and point in a topic that takes values; None if it is another topic."""
        match setting.split("/"):
            case [root, site, device, point, "set"] if root == _ROOT and site == self.site:
                return device, point
        return None

    @staticmethod
    def result(setting: str) -> str:
        """Where it is told what became of a value, by the topic that has taken it."""
        return f"{setting.removesuffix('/set')}/result"


@dataclass(frozen=True, slots=True)
class SparkplugTopics:
    """The topics of an edge node."""

    group: str
    node: str

    def of(self, kind: str, device: str = "") -> str:
        """The topic of a `kind` of messages (NBIRTH, DDATA), of the node itself or of one of its devices."""
        topic = f"{_NAMESPACE}/{self.group}/{kind}/{self.node}"
        return f"{topic}/{device}" if device else topic

    @staticmethod
    def state(host: str) -> str:
        """Whether a host is there."""
        return f"{_NAMESPACE}/STATE/{host}"
