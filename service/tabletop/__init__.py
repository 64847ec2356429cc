"""Whole scenes: the plane that bears objects, the objects, and each as the engine takes it.

With SciPy's trees, hulls and connected components, and nothing beyond the service's own dependencies.
"""

from service.tabletop.records import REASONS, Box, LeftOut, Plane, Scene, SceneObject, TabletopParams
from service.tabletop.scene import find_objects
from service.tabletop.sight import cut_out

__all__ = ["REASONS", "Box", "LeftOut", "Plane", "Scene", "SceneObject", "TabletopParams", "cut_out", "find_objects"]
