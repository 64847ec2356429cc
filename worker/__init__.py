"""The training worker: makes the models with which the service answers."""
