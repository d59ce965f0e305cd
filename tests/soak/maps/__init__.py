"""What the world `maps` consists of: devices with values of every type, random maps of them, and who judges reads.

- conversion   how registers carry numbers, and what a row shows: written anew, with fractions
- devices      devices whose values say whose they are and when they told them
- rows         rows of a map, as the config has them and as they should be seen
- random_rows  random rows over some devices
- changing     a config whose maps, rows, devices and lines change
- polls_seen   which polls were sent and answered: what is fresh
- reading, writing    what a client may be answered
- clients      clients that read and write, and judge every answer
"""
