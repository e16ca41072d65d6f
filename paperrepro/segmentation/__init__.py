"""From the points of a strip to its gable roofs: `roofs.candidates`, `roofs.extract`."""
