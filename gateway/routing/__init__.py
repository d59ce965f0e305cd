"""From a unit identifier to its target, and the rights of clients.

- router       looks up the target and the right
- access       the rows of [[access]] (ADR 10)
- audit        the log of writes
- broadcast    requests to unit 0
"""
