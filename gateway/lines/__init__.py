"""A line: chooses the next request to send, and finds its response among the received frames.

- line         the state machine: one request at a time
- turns        fair turns: each address one per round, urgent ones first
- queue, scheduler    requests that wait, are refused, or must not be sent yet
- waiting      what lines and upstreams decide alike, and what differs
- ledger, exchange    responses that may still come: late, to other clients, held back by a connection (ADR 5)
- attribution  the owner of each received frame: the table of rules (ADR 14)
- receiver, echo    the outcome of a request; copies of our own requests
- pacing, foresight    when the port is read (ADR 11), and when a usual response is (ADR 44)
- bits         a write to bits of a register: a read and a write in one turn (ADR 33)
- last_reads   the last response to each read of a device, for those who want to see its values
- breaker, idle, reopening    back-off of units, scans in idle time, requests that wait for a connection
- telling, refusals, counts    events, records for the trace, counters for the status
- driver       connects a line to port and event loop
- monitor      a line where the gateway only listens
"""
