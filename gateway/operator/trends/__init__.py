"""Trends: least, mean and greatest value of points in slots of time, from the responses that pass anyway.

- kept, sampler    what grows while the gateway runs, and looks for new responses once a second
- numbers      the numbers in a response, found by functions that are prepared for it
- trends, table    the trends of all points: what is not written yet, and the file that has the rest
- told         the trend of a point, as an operation and for pages
"""
