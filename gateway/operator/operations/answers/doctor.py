"""The result of `doctor`."""

from dataclasses import dataclass

from gateway.diagnosis.evidence import PortInUse
from gateway.diagnosis.finding import Finding


@dataclass(frozen=True, slots=True)
class Examination:
    """Findings about lines, units and clients, and the serial ports, which can be examined from outside."""

    findings: tuple[Finding, ...]
    ports: tuple[PortInUse, ...]
