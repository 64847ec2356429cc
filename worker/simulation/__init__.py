"""Mental simulation (Alg. 1): abstract objects, composed of primitives and seen by a virtual depth camera."""
