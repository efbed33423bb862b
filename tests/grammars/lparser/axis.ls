# Three steps along the axes of the turtle.
1 # recursion
90 # angle
10 # thickness

[F][+F][^F]
@
