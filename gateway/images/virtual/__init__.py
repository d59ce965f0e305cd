"""Virtual units: registers of many devices under one unit, in one block (`[[image]] map`).

- settings     what a row maps, as the config says it
"""
