"""Whole scenes: the plane that bears objects, the objects, and each as the engine takes it.

With SciPy's trees, hulls and connected components, and nothing beyond the service's own dependencies.
"""

from typing import TYPE_CHECKING, Any

from service.tabletop.records import REASONS, Box, LeftOut, Plane, Scene, SceneObject, TabletopParams

if TYPE_CHECKING:
    from service.tabletop.scene import find_objects
    from service.tabletop.sight import cut_out

__all__ = ["REASONS", "Box", "LeftOut", "Plane", "Scene", "SceneObject", "TabletopParams", "cut_out", "find_objects"]


def __getattr__(name: str) -> Any:
    """Imports what finds objects when it is asked for: SciPy's part takes longer than an answer to a single object."""
    if name == "find_objects":
        from service.tabletop.scene import find_objects

        return find_objects
    if name == "cut_out":
        from service.tabletop.sight import cut_out

        return cut_out
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
