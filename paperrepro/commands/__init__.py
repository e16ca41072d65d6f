"""The commands, a module each: ``add`` declares its options, ``run`` does it.

The command line alone brings simulator and method together.
"""
