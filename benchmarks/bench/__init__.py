"""How fast the law and the simulator are, beside named peers in the same minute.

What `cohelm bench` runs; it travels in the wheel as `cohelm.bench`.
"""
