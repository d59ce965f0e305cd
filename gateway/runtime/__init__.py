"""A gateway at work: its parts, how they are built of a plan, and how a reload replaces them."""
