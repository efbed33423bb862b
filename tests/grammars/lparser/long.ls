# A rule in two lines.
1
45
10
A
A=FFF
 FF
@
