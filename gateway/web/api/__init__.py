"""The HTTP API below /api/v1.

- operations, asking    the routes that the table of operations makes, and who asks by a request for what
- api, trace, session    what only HTTP can do: sessions, streams, files
- document, schemas    make openapi.json when an operation has changed; a gateway at work does not load them
"""
