"""Units, as clients see them and as devices and images answer for them.

- units        describe units, and find units and lines by number or name
- reached      the device or image that answers for a unit, and what clients may read of it
- calibration, answer_times    measured response times of a device, beside its limits
- rights       who may do what
- forgetting   the operation `forget`
"""
