"""Log events: one class for each, logged under its name in snake_case.

Events are for what is rare. What happens in every transaction is counted, by each part.

Public are these classes with their fields, `name` (`line_lost` for LineLost), `level`, `fields()` and `in_words()`.
"""

from gateway.events.clients import *
from gateway.events.event import *
from gateway.events.lines import *
from gateway.events.remote import *
from gateway.events.service import *

#: `Emit` and `discard_event` are for the parts of the gateway, and not public.
__all__ = (
    "AccessDenied",
    "AddressMoved",
    "AddressRemembered",
    "AnswerTooEarly",
    "AnswerWithheld",
    "BadFrame",
    "BaudChanged",
    "BaudRemembered",
    "BrokerLost",
    "BrokerRefused",
    "BrokerUp",
    "CertificateExpires",
    "ClientClosed",
    "ClientConnected",
    "ClientEvent",
    "ClientRejected",
    "CommandRefused",
    "ConfigApplied",
    "ConfigLoaded",
    "ConfigRejected",
    "ConfigWarning",
    "ConnectionRenewed",
    "ControlClosed",
    "CustomUnitFailed",
    "CustomUnitsLeft",
    "EchoHeard",
    "Emit",
    "Event",
    "EventsDropped",
    "FleetBucketUnsafe",
    "FleetLost",
    "FleetRefused",
    "FleetUp",
    "ForeignFrame",
    "KeptValuesSent",
    "LateResponse",
    "LeaseLost",
    "LeaseTaken",
    "Level",
    "LineLost",
    "LineReopened",
    "LineUp",
    "ListenerUp",
    "OtherClientHeard",
    "PartFailed",
    "PollRefused",
    "QueueFull",
    "Ready",
    "RequestRefused",
    "RequestTimeout",
    "StateDamaged",
    "StateKeptAgain",
    "StateNotKept",
    "Stopped",
    "Stopping",
    "TimingTight",
    "UnitRecovered",
    "UnitResting",
    "UpstreamClosed",
    "ValuesGivenUp",
    "WebClosed",
    "WebDenied",
    "WebLogin",
    "WebLoginFailed",
    "WebUp",
    "WebUsersRejected",
    "WriteAudit",
    "discard_event",
)
