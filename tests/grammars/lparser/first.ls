# The first rule of a letter applies.
1
45
10
A
A=F
A=FFF
@
