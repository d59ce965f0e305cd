"""TLS: certificates and what they say, their files, and the contexts that connections are secured with."""
