"""From a unit identifier to its target, and the rights of clients.

- router       looks up the target and the right
- access       the rows of [[access]], and the places where clients connect (ADR 10)
- deciding     which row decides about a request to a unit, address by address (ADR 39)
- rights       the same for all units and clients of an entry point, as look-ups
- audit        the log of writes
- broadcast    requests to unit 0
"""
