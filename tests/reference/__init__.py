"""The float64 truth that the renderer is tested against: closed forms, two brute-force tracers, and statistics.

Nothing here shares code with pyrt beyond the data classes of `pyrt.scene`, and `pyrt.device`, which opens devices.
"""
