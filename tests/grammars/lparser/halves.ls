# Half steps, moves, and moves without drawing.
1
90
10
FZfzgF
@
