"""The text of `pyrt info`: what a scene holds, what it will need, and which kernel features it compiles in."""

from __future__ import annotations

from pyrt.features import feature_table
from pyrt.memory import estimate, picture_bytes
from pyrt.pack import pack_scene
from pyrt.scene import Scene


def scene_report(scene: Scene, picture: int | None = None) -> str:
    """A few lines of text; builds the tree, renders nothing.

    `picture`: bytes that the picture takes, if it is not a plain one of the scene's size and samples.
    """
    width, height = scene.film.width, scene.film.height
    need = estimate(scene, picture_bytes(scene, width * height, scene.spp) if picture is None else picture)
    need.require(scene.name)
    report = pack_scene(scene).report
    scene_mib, picture_mib = (need.scene + need.build) / 2**20, need.picture / 2**20
    lines = [
        f"scene      {scene.name}: {width}x{height}, {scene.spp} spp, at most {scene.max_depth} specular events",
        f"geometry   {report['triangles']:,} triangles, {report['spheres']:,} spheres",
        f"lights     {report['lights']:,}",
        f"texels     {report['texels']:,}",
        f"tree       {report['nodes']:,} nodes, {report['blocks']:,} blocks, depth {report['depth']}",
        f"memory     about {need.total / 2**20:.0f} MiB ({scene_mib:.1f} scene, {picture_mib:.1f} picture)",
    ]
    if report["dropped_triangles"]:
        lines.append(f"dropped    {report['dropped_triangles']:,} triangles without area or with bad coordinates")
    lines.append("features")
    for row in feature_table(scene):
        lines.append(f"  {'on ' if row.on else 'off'}  {row.macro:<21} {row.adds:<32} {row.reason}")
    return "\n".join(lines)
