"""`[mqtt]`: publishes values to a broker, while the config says so. What publishes them is in `gateway.plant`.

- add_on       publishes what the plan of a gateway says; stops where it says something else
- publication  what one plan needs; loaded only then
- announcing, announced    what brokers keep of devices, and how it is taken back
- metrics, findings    what is counted, and what `doctor` says
"""
