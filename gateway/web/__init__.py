"""The gateway over HTTP: pages, API, metrics. Loaded only if the config has `[web]`.

- front        connections, TLS, all routes, and what is common to them
- access       logins, sessions, and who may do what
- api          what programs ask below /api/v1
- pages        what browsers show
- text         languages and themes of the pages
"""
