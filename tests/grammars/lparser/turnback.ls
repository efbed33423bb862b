# There and back.
1
45
10
F|F
@
