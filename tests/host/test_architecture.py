"""The shape of the package: who may import what, and what a start does not load."""

import ast
import re
import subprocess
import sys
from pathlib import Path

import pytest

import pyrt

SOURCES = {file.stem: file.read_text(encoding="utf-8") for file in sorted(Path(pyrt.__file__).parent.glob("*.py"))}

# A module imports only from the lines below its own. A new module gets a place here.
LAYERS = """
__main__
cli
cli_render cli_merge cli_image cli_denoise cli_scene cli_device
cli_report
cli_options
__init__
api info progress terminal compare checkup schema_reference
farm
intersector
renderer tracer
picture
result device_scene request
aov
watch
checkpoint primitives memory
adaptive
guide
passes doctor
device_sah
device pack scene_io partial_file
pack_lights tree scene_json scene_objects camera rays hit_lists
model_io loading
gltf_scene
mesh_io studio model smooth
gltf_mesh
gltf
gltf_schema
features geometry bvh image_io schema_errors scene_hash partial
scene_camera schema sah procedural mesh_data mesh_obj mtl image_file
schema_camera
scene layout settings files toolchain drivers schema_types exr_state film signals image_tools denoise
room
errors
"""
LEVEL = {module: -level for level, line in enumerate(LAYERS.splitlines()) for module in line.split()}
ONLY_IN = {
    "pyopencl": "device",
    "OpenImageIO": "image_io image_tools image_file exr_state",
    "pyoidn": "denoise",
    "trimesh": "mesh_io intersector",
}
HEAVY = {*ONLY_IN, "numpy", "pydantic", "rich", "scipy"}


def imports(source: str) -> set[str]:
    """Names that a module imports anywhere: "pyrt.x" for its own package, else the top-level package."""
    names = set()
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.ImportFrom):
            names |= {f"pyrt.{alias.name}" for alias in node.names} if node.module == "pyrt" else {node.module}
        elif isinstance(node, ast.Import):
            names |= {alias.name for alias in node.names}
    return {name if name.startswith("pyrt.") else name.partition(".")[0] for name in names}


def violations(module: str, source: str) -> list[str]:
    found = []
    for name in sorted(imports(source)):
        inner = name.removeprefix("pyrt.")
        if inner != name and inner in LEVEL and LEVEL[inner] >= LEVEL[module]:
            found.append(f"{module} imports {inner}, which is not below it")
        if module not in ONLY_IN.get(name, module).split():
            found.append(f"{module} imports {name}, which only {ONLY_IN[name]} may")
    return found


def test_every_module_has_a_layer():
    assert set(SOURCES) <= set(LEVEL)


@pytest.mark.parametrize("module", SOURCES)
def test_imports_point_downwards(module):
    assert violations(module, SOURCES[module]) == []


@pytest.mark.parametrize(
    ("module", "source"),
    [
        ("scene", "from pyrt.api import load_scene"),
        ("scene", "from pyrt import api"),
        ("pack", "def f():\n    import pyrt.device"),
        ("pack", "import pyopencl as cl"),
        ("cli", "from OpenImageIO import ImageBuf"),
    ],
)
def test_a_violation_is_seen(module, source):
    assert len(violations(module, source)) == 1


def test_no_module_hides_a_public_name():
    """Python binds `pyrt.x` to the module x as soon as anything imports it."""
    assert not set(pyrt.__all__) & set(SOURCES)


def test_public_names_exist():
    for name in pyrt.__all__:
        assert getattr(pyrt, name) is not None
    with pytest.raises(AttributeError, match="no attribute 'Rendrer'"):
        _ = pyrt.Rendrer


def loaded(*command: str) -> set[str]:
    """Modules that a fresh Python loads for the command."""
    done = subprocess.run([sys.executable, "-X", "importtime", *command], capture_output=True, text=True, check=True)
    return set(re.findall(r"\| +([\w.]+)$", done.stderr, re.MULTILINE))


@pytest.mark.parametrize(
    "command", [("-c", "import pyrt"), ("-m", "pyrt", "--help"), ("-m", "pyrt", "diff", "--help")], ids=" ".join
)
def test_a_start_loads_nothing_heavy(command):
    assert not loaded(*command) & HEAVY


def test_a_scene_loads_no_reader_that_it_has_no_use_for():
    modules = loaded("-c", "import pyrt; pyrt.load_scene('example:cornell')")
    assert "pyrt.mesh_obj" in modules
    assert not modules & {"pyrt.gltf_schema", "numpy.ma", "trimesh", "pyopencl"}


def test_a_heavy_import_is_seen():
    assert loaded("-c", "import pyrt.scene") & HEAVY == {"numpy"}
