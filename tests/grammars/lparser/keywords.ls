# The form of keywords.
recursion 3
angle 22.5
thickness 8
min_thickness 2
color 1 90 60 30
color 2 40 160 60
axiom c(1)FX
rule X = F [ + c(2) X ] [ - c(2) X ]
mutation 3
shape 1
