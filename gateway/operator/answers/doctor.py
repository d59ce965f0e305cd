"""What is wrong, and which ports are to be looked at."""

from dataclasses import dataclass

from gateway.diagnosis.evidence import PortInUse
from gateway.diagnosis.finding import Finding


@dataclass(frozen=True, slots=True)
class Examination:
    """What was found about lines, units and clients, and the ports that can be looked at from outside."""

    findings: tuple[Finding, ...]
    ports: tuple[PortInUse, ...]
