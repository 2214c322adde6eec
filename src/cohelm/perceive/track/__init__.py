"""Who moves, and what may."""
