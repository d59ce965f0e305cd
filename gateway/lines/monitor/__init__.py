"""A line where others ask and answer, and the gateway only listens (docs/promise.md, values that were only heard).

- monitor      finds the transactions of others, and says which of their values can be believed
- requests     requests whose answers may still come, and what else may have been one
- succession   cuts the bytes of a bus into frames, and stretches of none
- driver       connects a monitor line to its port and event loop
"""
