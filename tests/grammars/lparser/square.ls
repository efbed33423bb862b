# A square: four steps and four turns.
0
90
5
F+F+F+F
@
