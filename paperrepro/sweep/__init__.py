"""Parameter sweeps: one notebook executed for every point of a grid, on one machine or on many.

`grid` says which runs there are, `task` makes one of them where a Dask worker has room, `drive`
hands them out and takes the results in, `store` keeps them.
"""
