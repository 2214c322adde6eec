"""A package for pytest: what its tests share is closed after the last of them, not after all."""
