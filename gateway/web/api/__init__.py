"""The HTTP API below /api/v1.

- operations, asking    the routes made from the table of operations; the asker and the parameters of a request
- api, trace, session    what only HTTP can do: sessions, streams, files
"""
