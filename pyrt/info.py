"""The text of `pyrt info`: what a scene holds, what it will need, and which kernel features it compiles in."""

from __future__ import annotations

from pyrt.features import feature_table
from pyrt.pack import pack_scene
from pyrt.passes import PASS_SAMPLES
from pyrt.scene import Scene

_BYTES_PER_SAMPLE = 12  # radiance of one pass, in float32
_BYTES_PER_PIXEL = 4 + 4 + 3 * 4 + 3 * 4 + 4  # counts, order, and the result's arrays
_BYTES_PER_SUM = 2 * 3 * 8  # of a pixel's samples and squares; the film keeps one for each bit of spp, and the total


def scene_report(scene: Scene) -> str:
    """A few lines of text; builds the tree, renders nothing."""
    report = pack_scene(scene).report
    width, height = scene.film.width, scene.film.height
    pixel = _BYTES_PER_PIXEL + _BYTES_PER_SUM * (1 + scene.spp.bit_count())
    host = width * height * pixel + min(PASS_SAMPLES, width * height * scene.spp) * _BYTES_PER_SAMPLE
    mib = {"scene": report["bytes"] / 2**20, "picture": host / 2**20}
    lines = [
        f"scene      {scene.name}: {width}x{height}, {scene.spp} spp, at most {scene.max_depth} specular events",
        f"geometry   {report['triangles']:,} triangles, {report['spheres']:,} spheres",
        f"lights     {report['lights']:,}",
        f"texels     {report['texels']:,}",
        f"tree       {report['nodes']:,} nodes, {report['blocks']:,} blocks, depth {report['depth']}",
        f"memory     about {sum(mib.values()):.0f} MiB ({mib['scene']:.1f} scene, {mib['picture']:.1f} picture)",
    ]
    if report["dropped_triangles"]:
        lines.append(f"dropped    {report['dropped_triangles']:,} triangles without area or with bad coordinates")
    lines.append("features")
    for row in feature_table(scene):
        lines.append(f"  {'on ' if row.on else 'off'}  {row.macro:<21} {row.adds:<32} {row.reason}")
    return "\n".join(lines)
