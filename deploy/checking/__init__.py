"""What deploy/check-release checks."""
