"""Files of a real flight: strips, trajectory and mounting in; adjusted strips out.

`flight.read_flight` makes a `Survey` of them, `adjust.adjust_strips` writes strips under another
mounting. Coordinates on disk are a map's; inside, everything lies in one local topocentric frame.
"""
