"""What deploy/release builds."""
