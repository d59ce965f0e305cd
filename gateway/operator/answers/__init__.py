"""What operations answer: dataclasses, which neither know the gateway nor take long to load."""
