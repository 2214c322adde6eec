"""Maps from drives: scans put together, loops closed."""
