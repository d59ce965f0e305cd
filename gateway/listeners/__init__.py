"""The addresses where clients connect, and the limits on clients.

- tcp, udp, tls, serial    one listener of each kind
- connection, tcp_stream, datagram    between a socket and the state machine of its client, which is in `sessions`
- admission, share_keys    the clients that are accepted, or closed when a listener is full (ADR 28)
- holds        the clients that are not read for a moment
- accepting    accepts connections, also without a free descriptor
- handshakes, handshake_turns, tls_stream, kept_sessions    TLS: the limits of handshakes, and sessions of TLS 1.2
- sockets, hosts    the sockets of a listener, and addresses as text
- settings     the settings of a listener, and failures that are not reported
"""
