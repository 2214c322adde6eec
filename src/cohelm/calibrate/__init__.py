"""How a robot really is: it drives a little, and what its model assumes is measured."""
