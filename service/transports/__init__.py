"""The wires on which the service answers; each converts, calls one use case, and converts back."""
