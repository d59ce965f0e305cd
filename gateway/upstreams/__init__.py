"""Units behind other Modbus TCP servers: several requests under way on one connection (ADR 6).

- upstream     the state machine: when which request is sent, repeated or given up
- in_flight    requests by transaction identifier: which of them a response answers
- connection   silences, identifier 0, idle connections: when a request may be sent on a connection
- settings     the settings of an upstream
- driver       connects an upstream to its connection and the event loop
"""
