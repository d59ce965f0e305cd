"""How the gateway is doing.

- status, lines    the status of everything; of lines
- virtual_sources  the state of the sources of a virtual unit
- unit_states, troubles    how units do in the last minutes, and what is wrong now
- metrics      counters for Prometheus
"""
