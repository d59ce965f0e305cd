"""Many gateways as one, over NATS."""
