# Lengths 1, .9, .45, 1 and widths by factors.
1
45
50
F'F'(.5)F"(2)"F!F?(2)F
@
