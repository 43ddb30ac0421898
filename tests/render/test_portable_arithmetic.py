"""The kernels' two forms of arithmetic: native instructions where there are some, OpenCL's functions elsewhere."""

import numpy as np
import pytest

import pyrt

SCENES = ["cornell_two_lights", "showcase"]


@pytest.mark.parametrize("name", SCENES)
def test_opencl_functions_give_the_same_bits_as_native_instructions(name: str) -> None:
    scene = pyrt.load_scene(f"example:{name}")
    native, portable, scalar = (
        pyrt.Renderer(scene, build_flags=flags).render(spp=2, size=(48, 32))
        for flags in ((), ("-DNATIVE_X86=0",), ("-DNATIVE_X86=0", "-DPACKET=1"))
    )
    np.testing.assert_array_equal(native.image, portable.image)
    np.testing.assert_array_equal(scalar.image, portable.image)
