"""From a unit identifier to its target, and the rights of clients.

- router       one look-up for the target, one for the right
- access       the rows of [[access]] (ADR 10)
- audit        what is logged of a write
- broadcast    where a request to unit 0 goes
"""
