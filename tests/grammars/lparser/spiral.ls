# Grows longer and wider at every turn.
20
20
10
A
A=F+"A
@
