# Keywords in any order and case.
axiom A
rule A = F ^ A
ANGLE 10
Recursion 9
