"""Errors of TLS, in words for an operator."""

import ssl
from typing import Final

#: By OpenSSL's names. The other end has sent those with ALERT.
_REASONS: Final = {
    "PEER_DID_NOT_RETURN_A_CERTIFICATE": "it shows no certificate",
    "WRONG_VERSION_NUMBER": "what it sends is not TLS",
    "HTTP_REQUEST": "what it sends is not TLS",
    "UNSUPPORTED_PROTOCOL": "it offers no version of TLS from 1.2 on",
    "VERSION_TOO_LOW": "it offers no version of TLS from 1.2 on",
    "NO_SHARED_CIPHER": "it offers no cipher suite with authenticated encryption and forward secrecy",
    "NO_SUITABLE_SIGNATURE_ALGORITHM": "it offers no signature that suits the certificate here",
    "UNEXPECTED_EOF_WHILE_READING": "it has closed the connection in the middle of it",
    "TLSV1_ALERT_UNKNOWN_CA": "it does not trust the authority of the certificate here",
    "TLSV13_ALERT_CERTIFICATE_REQUIRED": "it wants a certificate",
    "SSLV3_ALERT_BAD_CERTIFICATE": "it does not accept the certificate here",
    "SSLV3_ALERT_CERTIFICATE_EXPIRED": "it says that the certificate here has expired, or is not valid yet",
    "SSLV3_ALERT_CERTIFICATE_REVOKED": "it says that the certificate here is revoked",
    "SSLV3_ALERT_CERTIFICATE_UNKNOWN": "it does not accept the certificate here",
    "SSLV3_ALERT_UNSUPPORTED_CERTIFICATE": "it says that the certificate here is for another purpose",
    "TLSV1_ALERT_PROTOCOL_VERSION": "it has no version of TLS from 1.2 on",
    "SSLV3_ALERT_HANDSHAKE_FAILURE": "both have no cipher suite in common, or it wants another certificate",
}


def explain(error: ssl.SSLError) -> str:
    """Say why TLS has failed, about the other end: `its certificate is refused: ...`."""
    if isinstance(error, ssl.SSLCertVerificationError):
        return f"its certificate is refused: {error.verify_message}"
    reason = error.reason or ""
    return _REASONS.get(reason) or reason.lower().replace("_", " ") or "TLS failed"
