"""How fast the law and the simulator are, beside named peers in the same minute."""
