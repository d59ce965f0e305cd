"""The topics of messages: plain ones, which are `PREFIX/SITE/DEVICE` and below, and Sparkplug B."""

from dataclasses import dataclass

from gateway.config.values.broker import PREFIX, SPARKPLUG


@dataclass(frozen=True, slots=True)
class Topics:
    """The topics of a site. Its `prefix` may have several levels."""

    site: str
    prefix: str = PREFIX

    @property
    def status(self) -> str:
        """The topic that tells whether the gateway is connected."""
        return f"{self._root}/status"

    def values(self, device: str) -> str:
        """Return the topic of the last values of a device."""
        return f"{self._root}/{device}"

    def availability(self, device: str) -> str:
        """Return the topic that tells whether a device answers."""
        return self.availability_of(self.values(device))

    @staticmethod
    def availability_of(values: str) -> str:
        """Return the topic that tells whether a device answers, given the topic of its last values."""
        return f"{values}/availability"

    def history(self, device: str) -> str:
        """Return the topic of earlier values of a device."""
        return f"{self.values(device)}/history"

    def setting(self, device: str, point: str) -> str:
        """Return the topic that takes values for a point."""
        return f"{self.values(device)}/{point}/set"

    @property
    def settings(self) -> str:
        """The filter for all topics that take values."""
        return self.setting("+", "+")

    def named(self, setting: str) -> tuple[str, str] | None:
        """Return the names of device and point in a topic that takes values; None if it is another topic."""
        root = f"{self._root}/"
        match setting.removeprefix(root).split("/"):
            case [device, point, "set"] if setting.startswith(root):
                return device, point
        return None

    @staticmethod
    def result(setting: str) -> str:
        """Return the topic of the results of writes, given the topic that takes the values."""
        return f"{setting.removesuffix('/set')}/result"

    @property
    def _root(self) -> str:
        return f"{self.prefix}/{self.site}"


@dataclass(frozen=True, slots=True)
class SparkplugTopics:
    """The topics of an edge node."""

    group: str
    node: str

    def of(self, kind: str, device: str = "") -> str:
        """Return the topic of a `kind` of messages (NBIRTH, DDATA), of the node itself or of one of its devices."""
        topic = f"{SPARKPLUG}/{self.group}/{kind}/{self.node}"
        return f"{topic}/{device}" if device else topic

    @staticmethod
    def state(host: str) -> str:
        """Return the topic that tells whether a host is online."""
        return f"{SPARKPLUG}/STATE/{host}"
