"""modbus-gateway: Modbus clients on one side, serial lines full of devices on the other.

Public are the names in `__all__`, and `gateway.events`; they follow semantic versioning. Each is loaded on first use.
See docs/library.md.
"""

from importlib import import_module

from gateway.version import __version__

TYPE_CHECKING = False  # Type checkers take it for true. That of `typing` would take longer than all the rest.
if TYPE_CHECKING:
    from gateway import events
    from gateway.config.problem import Problem
    from gateway.errors import (
        AccessDenied,
        Busy,
        ConfigError,
        DeviceFailure,
        GatewayError,
        IllegalAddress,
        IllegalFunction,
        IllegalValue,
        LineDown,
        ListenError,
        NoResponse,
        NotConfigured,
        Refused,
        RequestError,
        StateError,
        TlsError,
    )
    from gateway.images.custom_unit import CustomUnit
    from gateway.library.gateway import Gateway
    from gateway.library.reading import Reading
    from gateway.library.unit_client import UnitClient
    from gateway.modbus.codes import Area

__all__ = (  # noqa: RUF022 - as the reader meets them
    "Gateway",
    "UnitClient",
    "Reading",
    "CustomUnit",
    "Area",
    "events",
    "GatewayError",
    "ConfigError",
    "Problem",
    "ListenError",
    "StateError",
    "TlsError",
    "NotConfigured",
    "RequestError",
    "NoResponse",
    "Busy",
    "LineDown",
    "Refused",
    "IllegalFunction",
    "AccessDenied",
    "IllegalAddress",
    "IllegalValue",
    "DeviceFailure",
    "__version__",
)

_ELSEWHERE = {
    "Gateway": "library.gateway",
    "UnitClient": "library.unit_client",
    "Reading": "library.reading",
    "CustomUnit": "images.custom_unit",
    "Area": "modbus.codes",
    "Problem": "config.problem",
}


if not TYPE_CHECKING:  # they would take any name for right

    def __getattr__(name: str) -> object:
        if name not in __all__:
            raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
        if name == "events":
            return import_module("gateway.events")
        value = getattr(import_module(f"gateway.{_ELSEWHERE.get(name, 'errors')}"), name)
        globals()[name] = value
        return value


def __dir__() -> list[str]:
    return [*__all__]
