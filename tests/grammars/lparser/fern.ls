# A fern: one side longer than the other.
10
30
12
^(15)A
A=F!(.86)'[+B][-B]&(4)A
B='(.6)!(.6)C
C=F'(.85)[+(50)F][-(50)F]C
@
