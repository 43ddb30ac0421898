"""Where pyrt stands: run time against error, ray rates, builds, start-up and numerics, with peers in the same run."""
