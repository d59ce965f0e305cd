"""What `doctor` looks at without a gateway.

- config             a config file, and the ports that it names
- hardware_report    an adapter, and what a person does with it by hand
"""
