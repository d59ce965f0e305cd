"""Many gateways as one, over NATS (ADR 25, 26).

- asker, exchange    how units of another site are asked
- owner, slots, serving, clock    what another site may ask here, and until when
- presence     what sites say of themselves
- lease, lease_records, lease_entry, standby    which of several gateways asks on a line
- link, connection, calls, bucket    the connection to NATS and its key-value store
"""
