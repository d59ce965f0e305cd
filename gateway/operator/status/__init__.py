"""How the gateway is doing.

- status       the status as a whole; of listeners and clients
- line_status, unit_status    its parts about lines, and about units
- virtual_sources  the state of the sources of a virtual unit
- unit_states, troubles    how units do in the last minutes, and what is wrong now
- metrics      counters for Prometheus
"""
