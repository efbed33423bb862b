# Bends down, the more the flatter it grows.
30
15
20
&(80)A
A=Ft(.05)A
@
