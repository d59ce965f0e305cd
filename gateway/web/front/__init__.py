"""HTTP connections, from their place among others to the answer.

- opening, settings    `[web]`: opens the server, and says where it listens
- server, machines    the routes of pages, API and metrics, with what is common to all
- connections, secured, pieces    how many connections there are, TLS, and aiohttp below both
- problems     errors as problems, by their kinds
- bodies, forms    the body of a request, and the fields of a form with a long one
- streams, downloads, turns    answers that last, and requests that wait for each other
"""
