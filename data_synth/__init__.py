"""The simulated farm and its flight: everything that knows the truth."""
