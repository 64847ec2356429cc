"""Shape Concepts: tells of an object's point cloud which learned shape concepts it resembles."""

__version__ = "0.1.0"
