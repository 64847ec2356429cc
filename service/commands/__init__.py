"""The commands of `shape-concepts`, one module a group, and what they share with those of the worker."""
