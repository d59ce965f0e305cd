"""The settings of listeners."""

from collections.abc import Iterable

from gateway.config.schema.listen import Listen
from gateway.listeners.settings import ListenSettings
from gateway.modbus.codes import BROADCAST_UNIT
from gateway.tls.settings import ServerTls


def listen_settings(listen: Listen, everyone: Iterable[Listen]) -> ListenSettings:
    """Turn a table into the settings of a listener, which is one of `everyone`."""
    bind = listen.bind
    return ListenSettings(
        name=listen.label,
        host=bind.host,
        port=bind.port,
        clients=listen.clients,
        reserve=listen.reserve,
        idle=listen.idle,
        in_flight=listen.in_flight,
        unit0=listen.unit0 if listen.upstream is None else BROADCAST_UNIT,  # there it is a unit of the server
        on_failure=listen.on_failure,
        source=listen.place,
        scheme=bind.scheme,
        ipv6_only=any(bind.takes_ipv4_of(other.bind) for other in everyone),
        line=listen.line or "",
        upstream=listen.upstream or "",
        shares_port=any(bind.has_port_of(other.bind) for other in everyone if other is not listen),
        tls=_server_tls(listen),
    )


def _server_tls(listen: Listen) -> ServerTls | None:
    if listen.certificate is None or listen.key is None:
        return None
    return ServerTls(listen.certificate, listen.key, listen.clients_ca, listen.crl)
