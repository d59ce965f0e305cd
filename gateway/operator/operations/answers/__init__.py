"""Results of operations: dataclasses that do not import the gateway and load quickly."""
