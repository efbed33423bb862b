# A number follows a symbol that a rule has made.
2
45
10
A(90)F
A=B
B=+
@
