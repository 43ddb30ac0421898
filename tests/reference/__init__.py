"""The float64 truth that the renderer is tested against: closed forms, a brute-force tracer, and statistics.

Nothing here shares code with pyrt beyond the data classes of `pyrt.scene`.
"""
