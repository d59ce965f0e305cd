"""Publishes what points of devices read to a broker (MQTT), and takes writes from there (ADR 22, 23).

- publisher, polls, changes    what is read when, and which values are new
- messages, topics, plain    the plain form; what each form must do
- sparkplug, sparkplug_payload, births    Sparkplug B
- discovery    what Home Assistant is told
- commands     writes from the broker
- broker, connection, client, steadiness    the connection, and when it is tried again
"""
