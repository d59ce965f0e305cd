"""TLS: certificates and what they say, their files, and the contexts that connections are secured with (ADR 21).

- contexts, store    versions and suites; loading and renewing
- files, settings    where certificates and keys are
- certificate, der   what a certificate says
- making       what `modbus-gateway certificates` makes
- status       what the status tells of a file
"""
