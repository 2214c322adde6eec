"""Sticks on the station's host: one port, an adapter for each kind of device."""
