"""What finds faults and measures: these send requests of their own."""
