"""What a robot is: its shape, its wheels and their limits."""
