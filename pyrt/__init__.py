"""pyrt, a ray tracer that Python drives and OpenCL runs.

    import pyrt
    result = pyrt.render(pyrt.load_scene("scenes/cornell.json"))
    result.save("cornell.exr")

`import pyrt` is quick: what needs numpy or OpenCL is imported when it is first used.
"""

from typing import TYPE_CHECKING, Any

from pyrt.errors import DeviceError, PyrtError, SceneError, UsageError

if TYPE_CHECKING:
    from pyrt.api import (
        AllHits,
        Hits,
        RayMeshIntersector,
        RayTracer,
        Renderer,
        Result,
        from_trimesh,
        load_scene,
        merge,
        render,
        render_parallel,
    )

__version__ = "0.1.0"

__all__ = [
    "AllHits",
    "DeviceError",
    "Hits",
    "PyrtError",
    "RayMeshIntersector",
    "RayTracer",
    "Renderer",
    "Result",
    "SceneError",
    "UsageError",
    "__version__",
    "from_trimesh",
    "load_scene",
    "merge",
    "render",
    "render_parallel",
]


def __getattr__(name: str) -> Any:
    if name not in __all__:
        raise AttributeError(f"module 'pyrt' has no attribute {name!r}")
    from pyrt import api

    return getattr(api, name)
