"""TLS: certificates, their files, and the contexts of connections (ADR 21).

- contexts, store    versions and suites; loading and renewing
- files, settings    the files of certificates and keys
- certificate, der   parsed certificates
- making       the certificates that `modbus-gateway certificates` makes
- status       the status of a file
"""
