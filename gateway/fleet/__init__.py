"""Many gateways as one, over NATS (ADR 25, 26).

- asker, exchange    requests to units of other sites
- owner, slots, serving, clock    requests from other sites, their limits and deadlines
- presence, inventory    the status that each site publishes, and what it is and has
- lease, lease_records, lease_entry, standby    which of several gateways may send on a line
- link, connection, calls, bucket    the connection to NATS and its key-value store
- credentials    the file with which a site logs in
- hub          the config of the NATS server, and the logins, of all sites
"""
