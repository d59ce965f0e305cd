"""The earlier name of ErrorBoundary, for `gateway.lines` until that uses the new one."""

from gateway.ports.error_boundary import ErrorBoundary

Border = ErrorBoundary
