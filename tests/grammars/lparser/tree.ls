# A tree that forks in three.
6               # recursion
30              # angle
20              # thickness
A               # axiom
A=!"F[&'A]>(120)[&'A]>(120)[&'A]
@
