"""Publishes what points of devices read to a broker (MQTT), and takes writes from there."""
