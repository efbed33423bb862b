# Random turns.
5
30
20
A
A=F~(20)[+~A][-~(40)A]
@
