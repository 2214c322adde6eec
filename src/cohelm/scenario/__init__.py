"""YAML to checked models to runs; unknown keys, wrong units and impossible worlds are refused."""
