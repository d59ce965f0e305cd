"""A line: which request is sent next, and which received frame is its response.

- line         one request at a time, its deadline, its end
- turns        whose request is next: each address one turn in a round, urgent ones first
- queue, scheduler    what waits, what is refused, what must not be sent yet
- ledger, exchange    what may still come: late responses, those of other clients, those a connection held back (ADR 5)
- attribution  whose a received frame is: the table of rules (ADR 14)
- receiver, echo, pacing    what becomes of it; copies of our own requests; when the port is read (ADR 11)
- breaker, idle, reopening    units that back off, scans in idle time, what waits for a connection to open again
- telling, counts    what the trace, the events and the status get
- driver       all of it on the event loop
"""
