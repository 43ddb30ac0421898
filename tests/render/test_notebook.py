"""Results in a notebook: IPython asks an object for `_repr_png_` and shows the bytes."""

from __future__ import annotations

import numpy as np

import pyrt
from pyrt.image_io import read_picture


def test_a_result_shows_itself(tmp_path):
    result = pyrt.render("example:cornell", spp=2, size=(16, 12))
    (tmp_path / "shown.png").write_bytes(result._repr_png_())
    result.save(tmp_path / "saved.png")
    shown, saved = (read_picture(tmp_path / name).pixels for name in ("shown.png", "saved.png"))
    np.testing.assert_array_equal(shown, saved)
    assert shown.any()
    assert repr(result) == "<Result 16x12, 2 spp>"
