"""Publishes what points of devices read to a broker (MQTT), and takes writes from there (ADR 22, 23).

- publisher, changes, device_reader    which values are published, and how they are read
- messages, topics, plain    the protocol of a form, and the plain one
- sparkplug, sparkplug_payload, births    Sparkplug B
- discovery    announcements for Home Assistant
- commands     writes from the broker
- kept         readings that could not be published (ADR 38)
- broker, connection, client, steadiness    the connection, and when the next one is made
"""
