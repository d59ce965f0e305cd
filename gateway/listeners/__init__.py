"""The addresses where clients connect, and how many may.

- tcp, udp, tls, serial    one listener of each kind
- connection, tcp_stream, datagram    what connects a socket to the machine of its client, which is in `sessions`
- admission, share_keys    who is accepted, and who is closed when a listener is full (ADR 28)
- accepting    connections taken from the system, also without a free descriptor
- handshakes, handshake_turns, tls_stream, kept_sessions    TLS: how many handshakes at once, and sessions of TLS 1.2
- settings     what a listener is given, and what a client gets without a response
"""
